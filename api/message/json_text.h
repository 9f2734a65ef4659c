// Functions that write JSON as text.
#pragma once

#include <string>

namespace selenograph::api {

// Returns JSON on one line, or indented. Bytes that are not UTF-8, in a file's name for example, become U+FFFD, so that
// nothing throws.
template <typename Json>
std::string json_text(const Json& json, int indent = -1) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

// Returns JSON on one line with a final newline, for answers and files.
template <typename Json>
std::string json_line(const Json& json) {
  return json_text(json) + "\n";
}

// Returns JSON on one line in ASCII, for headers and attributes of images.
template <typename Json>
std::string json_ascii(const Json& json) {
  return json.dump(-1, ' ', true, Json::error_handler_t::replace);
}

}  // namespace selenograph::api
