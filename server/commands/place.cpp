#include "server/commands/place.h"

#include <GeographicLib/DMS.hpp>
#include <cmath>

namespace selenograph::server {

std::optional<Geographic> place_of(const std::string& text) {
  const std::size_t comma = text.find(',');
  if (comma == std::string::npos) return std::nullopt;
  Geographic position{0, 0, 0};
  try {
    GeographicLib::DMS::DecodeLatLon(text.substr(0, comma), text.substr(comma + 1), position.lat_deg, position.lon_deg);
  } catch (const GeographicLib::GeographicErr&) {
    return std::nullopt;
  }
  // GeographicLib takes NaN, and any longitude.
  const bool is_valid = !std::isnan(position.lat_deg) && position.lon_deg >= -180 && position.lon_deg <= 360;
  return is_valid ? std::optional(position) : std::nullopt;
}

}  // namespace selenograph::server
