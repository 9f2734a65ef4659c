// Landscape before craters: highlands, and maria that flood them.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "dem/sample/crater_profile.h"

namespace selenograph::dem::sample {

// Height at one post, split by the size of the relief. Layer 0 is never erased; layer o + 1 has relief of the size of
// craters of octave o. A new crater erases older relief of up to twice its own size, and is added to larger relief.
// Superposition is therefore local to each post: no crater needs heights elsewhere, so tiles cannot disagree.
struct Layers {
  std::array<float, 16> m{};
  double sum() const {
    double total = 0;
    for (const float layer : m) total += static_cast<double>(layer);
    return total;
  }
};

inline int layer_of_octave(int octave) { return std::min(octave + 1, 15); }

// Pure function of position and seed.
class Landscape {
 public:
  explicit Landscape(std::uint64_t seed) : seed_(mix(seed, 77)) {}

  // Adds highlands, with basins from the lowest frequencies of a noise. `p_m`: position on the sphere, m.
  void lay_highlands(const Vec3& p_m, Layers& layers) const;
  // Fills the basins with lava up to its level, which buries all relief below, including small relief.
  void flood_maria(const Vec3& p_m, Layers& layers) const;

 private:
  double noise(const Vec3& p_m, double cell_m, std::uint64_t salt) const {
    return gradient_noise(p_m.x() / cell_m, p_m.y() / cell_m, p_m.z() / cell_m, seed_ + salt);
  }
  double basin_field(const Vec3& p_m) const {
    return noise(p_m, 700e3, 1) + 0.4 * noise(p_m, 230e3, 2) + 0.15 * noise(p_m, 70e3, 3);
  }
  double wrinkle_ridges_m(const Vec3& p_m) const;

  std::uint64_t seed_;
};

}  // namespace selenograph::dem::sample
