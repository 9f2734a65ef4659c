// A campaign's requests: one per line, each with a name.
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "api/json/json_reader.h"

namespace selenograph::server {

// Maximum bytes of a frame's name. With its suffix it fits a plain tar header.
inline constexpr std::size_t kMaxFrameNameBytes = 90;

// A problem document, as the service answers it.
using Problem = nlohmann::ordered_json;

struct ManifestLine {
  std::size_t number = 0;  // in the file, from 1
  std::string name;
  std::string_view text;
  // Reason why the line can never become a frame, if the manifest alone shows one.
  std::optional<Problem> problem;
};

// The lines of a manifest. Empty ones are ignored. A line without a "name" is named by its number, with leading zeros:
// six digits, or more if the file has more. Names consist of letters, digits, '.', '_' and '-', and do not begin with
// '.' or '-'. A repeated name is a problem.
class Manifest {
 public:
  // Throws std::runtime_error naming the file.
  explicit Manifest(const std::string& path);
  Manifest(const Manifest&) = delete;
  Manifest& operator=(const Manifest&) = delete;

  const std::string& path() const { return path_; }
  const std::vector<ManifestLine>& lines() const { return lines_; }
  // Returns the request of a line without a problem.
  api::Json request(const ManifestLine& line) const;

 private:
  std::string path_, text_;
  std::vector<ManifestLine> lines_;
};

// Returns the problem document of an answer.
Problem problem_of(const std::string& body, int status);

}  // namespace selenograph::server
