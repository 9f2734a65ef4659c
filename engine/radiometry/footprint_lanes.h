// Positions and sizes of sixteen pixels' footprints on a map, computed relative to one of them by series instead of arc
// tangents.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "dem/grid/geodesy.h"
#include "dem/value_maps/value_map.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// A reference place for others nearby. Written out on the sphere, since a texel does not depend on the last digits:
// to_geographic took a third of the time.
struct Near {
  explicit Near(const Vec3& place) {
    const double ring = std::max(std::sqrt(place.x() * place.x() + place.y() * place.y()), 1e-6);
    up = place.normalized(), east = {-place.y() / ring, place.x() / ring, 0}, north = up.cross(east);
    sin_lat = up.z(), cos_lat = ring / place.norm();
    lat_deg = std::atan2(place.z(), ring) * kDegreesPerRadian;
    lon_deg = std::atan2(place.y(), place.x()) * kDegreesPerRadian;
  }
  Vec3 east, north, up;
  double sin_lat, cos_lat, lat_deg, lon_deg;
};

// Metres east and north from one sample's ray to the next one's, to the right and down in the image.
static_assert(dem::kFootprints == kPacket);
struct alignas(64) FootprintLanes {
  double lat_deg[kPacket], lon_deg[kPacket], cos_lat[kPacket];
  double right_m[2][kPacket], down_m[2][kPacket];

  dem::ValueMap::Footprint2 at(int i) const {
    return {lat_deg[i], lon_deg[i], {right_m[0][i], right_m[1][i]}, {down_m[0][i], down_m[1][i]}, cos_lat[i]};
  }
  dem::Footprints all() const { return {lat_deg, lon_deg, cos_lat, right_m[0], right_m[1], down_m[0], down_m[1]}; }
  void set(int i, const dem::ValueMap::Footprint2& f) {
    lat_deg[i] = f.lat_deg, lon_deg[i] = f.lon_deg, cos_lat[i] = f.cos_lat;
    for (std::size_t k = 0; k < 2; ++k) right_m[k][i] = f.a_m[k], down_m[k][i] = f.b_m[k];
  }
};

}  // namespace selenograph::engine
