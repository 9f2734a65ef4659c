// Errors that a caller can act on. Every message names the file, tile or member that is at fault.
#pragma once

#include <stdexcept>
#include <string>
#include <utility>

namespace selenograph {

// A DEM file is missing, truncated, corrupt or says things that can't be. `file` is the path as the user gave it.
class DataError : public std::runtime_error {
 public:
  DataError(std::string file, const std::string& what_is_wrong)
      : std::runtime_error(file + ": " + what_is_wrong), file_(std::move(file)) {}
  const std::string& file() const { return file_; }

 private:
  std::string file_;
};

// A request needs more terrain at once than the memory that it may use holds.
class TooMuchTerrain : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

// Work was given up because its deadline passed or its client left.
class Cancelled : public std::runtime_error {
 public:
  Cancelled() : std::runtime_error("cancelled") {}
};

}  // namespace selenograph
