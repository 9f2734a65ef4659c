// Upper bound of the memory of a JSON document, known from its text before it is parsed.
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <string_view>

namespace selenograph::api {

// Returns an upper bound of the memory that parse_json(text) takes, its result included. The number of values follows
// from the punctuation: a text of empty objects takes fifty times its own size, one of long numbers four times.
inline std::size_t document_bytes(std::string_view text) {
  // Element of an array: a full vector doubles its capacity, and holds the old and the new storage meanwhile.
  constexpr std::size_t kElement = 3 * sizeof(nlohmann::json);
  constexpr std::size_t kObject = 48, kArray = 32, kMember = 80, kString = 32;  // heap allocation of each
  constexpr std::size_t kCharacter = 3;                                         // strings double their capacity, too
  std::size_t bytes = sizeof(nlohmann::json) + kCharacter * text.size();
  for (const char c : text) {
    switch (c) {
      case ',':
        bytes += kElement;
        break;
      case '{':
        bytes += kObject + kElement;
        break;
      case '[':
        bytes += kArray + kElement;
        break;
      case ':':
        bytes += kMember;
        break;
      case '"':
        bytes += kString / 2;  // each string has two quotation marks
        break;
      default:
        break;
    }
  }
  return bytes;
}

}  // namespace selenograph::api
