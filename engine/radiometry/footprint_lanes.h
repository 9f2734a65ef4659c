// Positions and sizes of sixteen pixels' footprints on a map. They are computed relative to one of them, by series
// instead of arc tangents.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>

#include "dem/grid/geodesy.h"
#include "dem/value_maps/value_map.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// A reference position for positions nearby, with its local axes. Spherical formulas suffice, since a texel does not
// depend on the last digits; to_geographic took a third of the time.
struct ReferencePosition {
  explicit ReferencePosition(const Vec3& position) {
    const double ring = std::max(std::sqrt(position.x() * position.x() + position.y() * position.y()), 1e-6);
    up = position.normalized();
    east = {-position.y() / ring, position.x() / ring, 0};
    north = up.cross(east);
    sin_lat = up.z();
    cos_lat = ring / position.norm();
    lat_deg = std::atan2(position.z(), ring) * kDegreesPerRadian;
    lon_deg = std::atan2(position.y(), position.x()) * kDegreesPerRadian;
  }
  Vec3 east, north, up;
  double sin_lat, cos_lat, lat_deg, lon_deg;
};

// Cache of reference positions of packets: most packets are near a recent one. A packet's reference follows from its
// first hit alone, whatever was cached: a corner of the cube of 2 km around it or, near the poles, where longitudes
// differ too much within a cube, the hit itself.
class ReferencePositions {
 public:
  const ReferencePosition& of(const Vec3& hit) {
    constexpr double kPolar = 0.97, kSide_m = 2000;  // sine of 76 degrees
    const auto x = static_cast<int>(hit.x() / kSide_m), y = static_cast<int>(hit.y() / kSide_m),
               z = static_cast<int>(hit.z() / kSide_m);
    Entry& entry = entries_[static_cast<std::size_t>((x & 1) | (y & 1) << 1 | (z & 1) << 2)];
    Vec3 position_m(kSide_m * x, kSide_m * y, kSide_m * z);
    if (hit.z() * hit.z() > kPolar * kPolar * hit.squared_norm()) position_m = hit;
    if (!entry.reference || entry.position_m != position_m) {
      entry.position_m = position_m;
      entry.reference.emplace(position_m);
    }
    return *entry.reference;
  }

 private:
  struct Entry {
    Vec3 position_m;
    std::optional<ReferencePosition> reference;
  };
  std::array<Entry, 8> entries_;
};

// Sixteen footprints: metres east and north from one sample's ray to the next, to the right and down in the image.
static_assert(dem::kFootprints == kPacket);
struct alignas(64) FootprintLanes {
  double lat_deg[kPacket], lon_deg[kPacket], cos_lat[kPacket];
  double right_m[2][kPacket], down_m[2][kPacket];

  dem::ValueMap::Footprint2 at(int i) const {
    return {lat_deg[i], lon_deg[i], {right_m[0][i], right_m[1][i]}, {down_m[0][i], down_m[1][i]}, cos_lat[i]};
  }
  dem::Footprints all() const { return {lat_deg, lon_deg, cos_lat, right_m[0], right_m[1], down_m[0], down_m[1]}; }
  void set(int i, const dem::ValueMap::Footprint2& f) {
    lat_deg[i] = f.lat_deg;
    lon_deg[i] = f.lon_deg;
    cos_lat[i] = f.cos_lat;
    for (std::size_t k = 0; k < 2; ++k) {
      right_m[k][i] = f.a_m[k];
      down_m[k][i] = f.b_m[k];
    }
  }
};

}  // namespace selenograph::engine
