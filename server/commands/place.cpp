#include "server/commands/place.h"

#include <charconv>
#include <cmath>

namespace selenograph::server {

std::optional<Geographic> place_of(const std::string& text) {
  const char* rest = text.data();
  const char* const end = text.data() + text.size();
  double angles[2];  // latitude, longitude
  for (int i = 0; i < 2; ++i) {
    if (i == 1) {
      if (rest == end || *rest != ',') return std::nullopt;
      ++rest;
    }
    const auto [number_end, error] = std::from_chars(rest, end, angles[i]);
    if (error != std::errc()) return std::nullopt;
    rest = number_end;
  }
  const bool is_valid = rest == end && std::abs(angles[0]) <= 90 && angles[1] >= -180 && angles[1] <= 360;
  return is_valid ? std::optional(Geographic{angles[0], angles[1], 0}) : std::nullopt;
}

}  // namespace selenograph::server
