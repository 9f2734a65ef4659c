#include "server/campaign/manifest.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <unordered_map>

#include "api/message/problem.h"
#include "dem/base/names.h"
#include "dem/files/files.h"

namespace selenograph::server {
namespace {

using api::Json;

constexpr const char* kName = "name";

bool is_frame_name(std::string_view text) {
  return text.size() <= kMaxFrameNameBytes && dem::consists_of(text, "_-.") && text.front() != '.' &&
         text.front() != '-';
}

[[noreturn]] void refuse_name(const std::string& why) {
  throw api::RequestError("invalid_request", "/name: " + why, {{"/name", why}});
}

std::string read_name(const Json& name) {
  if (name.is_string() && is_frame_name(name.get_ref<const std::string&>())) return name;
  refuse_name(fmt::format("must be 1 to {} letters, digits, '.', '_' and '-', beginning with neither '.' nor '-'",
                          kMaxFrameNameBytes));
}

// Returns the non-empty lines with their numbers and text.
std::vector<ManifestLine> split(std::string_view text) {
  std::vector<ManifestLine> lines;
  for (std::size_t number = 1; !text.empty(); ++number) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    if (line.find_first_not_of(" \t\r") == std::string_view::npos) continue;
    lines.push_back({.number = number, .name = {}, .text = line, .problem = {}});
  }
  return lines;
}

}  // namespace

Problem problem_of(const std::string& body, int status) {
  Problem problem = Problem::parse(body, nullptr, false);
  return problem.is_object() ? problem : Problem{{"status", status}, {"detail", "no answer"}};
}

// answer_or_problem() turns the exceptions of reading a line into the problem that the service would answer.
Manifest::Manifest(const std::string& path) : path_(path), text_(dem::read_whole(path)) {
  lines_ = split(text_);
  if (lines_.empty()) throw std::runtime_error(path + ": has no lines");
  // Line numbers as names have as many digits as the last one.
  const std::size_t digits = std::max<std::size_t>(6, std::to_string(lines_.back().number).size());
  std::unordered_map<std::string_view, std::size_t> line_of_name;
  line_of_name.reserve(lines_.size());
  for (ManifestLine& line : lines_) {
    // Name of a line that turns out to be invalid.
    line.name = fmt::format("{:0{}}", line.number, digits);
    const api::Response result_of_reading = api::answer_or_problem({}, [&] {
      Json request = api::parse_json(line.text);
      if (request.is_object() && request.contains(kName)) {
        line.name = read_name(request[kName]);
        request.erase(kName);
      }
      const auto [first, is_new] = line_of_name.emplace(line.name, line.number);
      if (!is_new) refuse_name(fmt::format("\"{}\" is the name of line {}", line.name, first->second));
      return api::Response{};
    });
    if (result_of_reading.status != 200) line.problem = problem_of(result_of_reading.body, result_of_reading.status);
  }
}

Json Manifest::request(const ManifestLine& line) const {
  Json request = api::parse_json(line.text);
  if (request.is_object()) request.erase(kName);
  return request;
}

}  // namespace selenograph::server
