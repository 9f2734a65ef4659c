#include "server/commands/place.h"

#include <charconv>
#include <cmath>

namespace selenograph::server {

std::optional<Geographic> place_of(const std::string& text) {
  const char* at = text.data();
  const char* const end = text.data() + text.size();
  double angles[2];
  for (int i = 0; i < 2; ++i) {
    if (i == 1 && (at == end || *at++ != ',')) return std::nullopt;
    const auto [next, error] = std::from_chars(at, end, angles[i]);
    if (error != std::errc()) return std::nullopt;
    at = next;
  }
  const bool is_valid = at == end && std::abs(angles[0]) <= 90 && angles[1] >= -180 && angles[1] <= 360;
  return is_valid ? std::optional(Geographic{angles[0], angles[1], 0}) : std::nullopt;
}

}  // namespace selenograph::server
