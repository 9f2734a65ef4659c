// Numbers that look random but are functions of place and seed: the same on every machine.
#pragma once

#include <cstdint>

namespace selenograph::dem {

// What a SplitMix64 generator makes of its state (Steele, Lea & Flood 2014).
inline constexpr std::uint64_t kSplitMixStep = 0x9E3779B97F4A7C15u;
inline constexpr std::uint64_t split_mix(std::uint64_t state) {
  state = (state ^ (state >> 30)) * 0xBF58476D1CE4E5B9u;
  state = (state ^ (state >> 27)) * 0x94D049BB133111EBu;
  return state ^ (state >> 31);
}

// Along the directions to the twelve edges of a cube, four of them twice (Perlin 2002).
inline double along_gradient(std::uint32_t direction, double x, double y, double z) {
  static constexpr double kGradient[16][3] = {{1, 1, 0},  {-1, 1, 0},  {1, -1, 0}, {-1, -1, 0}, {1, 0, 1},  {-1, 0, 1},
                                              {1, 0, -1}, {-1, 0, -1}, {0, 1, 1},  {0, -1, 1},  {0, 1, -1}, {0, -1, -1},
                                              {1, 1, 0},  {-1, 1, 0},  {0, -1, 1}, {0, -1, -1}};
  const double* g = kGradient[direction];
  return g[0] * x + g[1] * y + g[2] * z;
}

// std::lerp guards cases that don't occur here, at several times the cost.
inline double blend(double a, double b, double t) { return a + t * (b - a); }

// Gradient noise in three dimensions (Perlin 2002), of unit wavelength, within +-1.0364. `direction(i, j, k)` is the
// gradient's number, 0 to 15, at a corner of the lattice.
template <typename Direction>
double perlin_noise(double x, double y, double z, const Direction& direction) {
  // So does std::floor.
  const auto floor_of = [](double v) {
    const auto whole = static_cast<std::int64_t>(v);
    return whole - (v < static_cast<double>(whole) ? 1 : 0);
  };
  const auto fade = [](double t) { return t * t * t * (t * (t * 6 - 15) + 10); };
  const std::int64_t i = floor_of(x), j = floor_of(y), k = floor_of(z);
  x -= static_cast<double>(i), y -= static_cast<double>(j), z -= static_cast<double>(k);
  const double u = fade(x), v = fade(y), w = fade(z);
  const auto along_x = [&](int dj, int dk) {
    const double a = along_gradient(direction(i, j + dj, k + dk), x, y - dj, z - dk);
    const double b = along_gradient(direction(i + 1, j + dj, k + dk), x - 1, y - dj, z - dk);
    return blend(a, b, u);
  };
  return blend(blend(along_x(0, 0), along_x(1, 0), v), blend(along_x(0, 1), along_x(1, 1), v), w);
}

}  // namespace selenograph::dem
