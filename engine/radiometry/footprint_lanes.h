// Positions and sizes of sixteen pixels' footprints on a map, computed relative to one of them by series instead of arc
// tangents.
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

// A reference place for others nearby. Written out on the sphere, since a texel does not depend on the last digits:
// to_geographic took a third of the time.
struct Near {
  explicit Near(const Vec3& place) {
    const double ring = std::max(std::sqrt(place.x() * place.x() + place.y() * place.y()), 1e-6);
    up = place.normalized(), east = {-place.y() / ring, place.x() / ring, 0}, north = up.cross(east);
    sin_lat = up.z();
    cos_lat = ring / place.norm();
    lat_deg = std::atan2(place.z(), ring) * kDegreesPerRadian;
    lon_deg = std::atan2(place.y(), place.x()) * kDegreesPerRadian;
  }
  Vec3 east, north, up;
  double sin_lat, cos_lat, lat_deg, lon_deg;
};

// Reference places of packets, remembered: most packets are near one of the last ones. A packet's own follows from
// nothing but its first hit, whatever was asked before: a corner of the cube of 2 km that holds it; near the poles,
// where longitudes differ too much within a cube, the hit itself.
class NearPlaces {
 public:
  const Near& of(const Vec3& place) {
    constexpr double kPolar = 0.97, kSide_m = 2000;  // sine of 76 degrees
    const auto x = static_cast<int>(place.x() / kSide_m), y = static_cast<int>(place.y() / kSide_m),
               z = static_cast<int>(place.z() / kSide_m);
    Held& held = held_[static_cast<std::size_t>((x & 1) | (y & 1) << 1 | (z & 1) << 2)];
    Vec3 at(kSide_m * x, kSide_m * y, kSide_m * z);
    if (place.z() * place.z() > kPolar * kPolar * place.squaredNorm()) at = place;
    if (!held.near || held.at != at) {
      held.at = at;
      held.near.emplace(at);
    }
    return *held.near;
  }

 private:
  struct Held {
    Vec3 at;
    std::optional<Near> near;
  };
  std::array<Held, 8> held_;
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
