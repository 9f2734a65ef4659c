// Light that does not come from the Sun directly, but from surrounding terrain and from the Earth.
#pragma once

#include <optional>

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

// The Earth as a source of light: a uniform disc.
struct Earth {
  Vec3 direction = Vec3::unit_x();  // unit vector from the Moon toward the Earth, MOON_ME
  double distance_m = 384.4e6;
};

struct IndirectLight {
  bool terrain = false;  // sunlight that terrain reflects
  int bounces = 1;       // number of reflections; 1 to 3
  // Distance in the image of the posts at which light is gathered, pixels; at least that of the terrain's posts or, for
  // values below 1, half of it.
  double spacing_px = kDefaultSpacing_px;
  static constexpr double kDefaultSpacing_px = 4;
  std::optional<Earth> earth;  // empty: none
  bool any() const { return terrain || earth; }
  // Returns a lower bound of the mean light from terrain on ground in shadow, as a share of the exact light. Measured
  // at the default spacing (engine/indirect/README.md); empty for a Sun below 2 degrees, where nothing was measured.
  static std::optional<double> shadow_light_at_least(double sun_elevation_deg) {
    constexpr double kBowls_deg = 2, kPolarPiece_deg = 5;
    if (sun_elevation_deg < kBowls_deg) return std::nullopt;
    return sun_elevation_deg < kPolarPiece_deg ? 0.8 : 0.88;
  }
};

}  // namespace selenograph::engine
