#include "server/commands/place.h"

#include <charconv>
#include <cmath>

namespace selenograph::server {

std::optional<Geographic> place_of(const std::string& text) {
  const char *at = text.data(), *const end = text.data() + text.size();
  double parts[2];
  for (int i = 0; i < 2; ++i) {
    if (i == 1 && (at == end || *at++ != ',')) return std::nullopt;
    const auto [next, error] = std::from_chars(at, end, parts[i]);
    if (error != std::errc()) return std::nullopt;
    at = next;
  }
  const bool good = at == end && std::abs(parts[0]) <= 90 && parts[1] >= -180 && parts[1] <= 360;
  return good ? std::optional(Geographic{parts[0], parts[1], 0}) : std::nullopt;
}

}  // namespace selenograph::server
