// Errors that a caller can act on. Every message names the file, tile or member that caused it.
#pragma once

#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>

namespace selenograph {

// A DEM file is missing, truncated, corrupt or contradicts itself. `file` is the path as the user gave it.
class DataError : public std::runtime_error {
 public:
  DataError(std::string file, const std::string& what_is_wrong)
      : std::runtime_error(file + ": " + what_is_wrong), file_(std::move(file)) {}
  const std::string& file() const { return file_; }
  std::string what_is_wrong() const { return std::string(what()).substr(file_.size() + 2); }

 private:
  std::string file_;
};

// The file is a valid image, but not of heights: its samples, bands or unit say so.
class NotHeights : public DataError {
  using DataError::DataError;
};

// A file could not be opened, read or written because of the system, not the file: no descriptors, no memory, a failing
// or full disk, no permission, a lost connection. The file is intact; retrying may help.
class SystemFault : public std::runtime_error {
 public:
  // `code`: value of errno.
  SystemFault(const std::string& file, int code) : SystemFault(file, code, std::generic_category().message(code)) {}
  SystemFault(std::string file, int code, const std::string& what_happened)
      : std::runtime_error(file + ": " + what_happened), file_(std::move(file)), code_(code) {}
  const std::string& file() const { return file_; }
  int code() const { return code_; }

 private:
  std::string file_;
  int code_;
};

// A well-formed request that cannot be served: the client must change it. Only this type becomes a client error; a
// library's std::invalid_argument is an internal error.
class ImpossibleRequest : public std::runtime_error {
 public:
  // `member`: the member of the engine's request to change, e.g. "max_error_px"; empty: none in particular.
  explicit ImpossibleRequest(const std::string& what_is_wrong, std::string member = {})
      : std::runtime_error(what_is_wrong), member_(std::move(member)) {}
  const std::string& member() const { return member_; }

 private:
  std::string member_;
};

// A request needs more terrain than its memory budget holds, or more sources than the product `source` can number.
class TooMuchTerrain : public ImpossibleRequest {
 public:
  using ImpossibleRequest::ImpossibleRequest;
};

// Work was cancelled because its deadline passed or its client disconnected.
class Cancelled : public std::runtime_error {
 public:
  Cancelled() : std::runtime_error("cancelled") {}

 protected:
  using std::runtime_error::runtime_error;
};

// Work was not started because it is expected to take much longer than its deadline allows.
class TooMuchWork : public Cancelled {
 public:
  TooMuchWork(const std::string& what_is_wrong, double predicted_ms)
      : Cancelled(what_is_wrong), predicted_ms_(predicted_ms) {}
  double predicted_ms() const { return predicted_ms_; }

 private:
  double predicted_ms_;
};

}  // namespace selenograph
