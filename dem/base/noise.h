// Pseudo-random numbers and gradient noise as functions of position and seed: the same on every machine.
//
//   (0,1,.) o-------o (1,1,.)     Each lattice point has one of twelve gradients, selected by its hash. The noise at P
//           |    P  |             blends gradient . (P - corner) over the cell's eight corners, along x, then y, then
//   (0,0,.) o-------o (1,0,.)     z, with the weights noise_fade.
#pragma once

#include <cstdint>

// Forces inlining into loops over lanes, which are vectorised only without calls.
#define SELENOGRAPH_INTO_LANES __attribute__((always_inline))

namespace selenograph::dem {

// Output function of a SplitMix64 generator (Steele, Lea & Flood 2014).
inline constexpr std::uint64_t kSplitMixStep = 0x9E3779B97F4A7C15u;
inline constexpr std::uint64_t split_mix(std::uint64_t state) {
  state = (state ^ (state >> 30)) * 0xBF58476D1CE4E5B9u;
  state = (state ^ (state >> 27)) * 0x94D049BB133111EBu;
  return state ^ (state >> 31);
}

// Factors of lattice_hash.
inline constexpr std::uint32_t kLatticeX = 0x8DA6B343u, kLatticeY = 0xD8163841u, kLatticeZ = 0xCB1AB31Fu;  // per axis
inline constexpr std::uint32_t kLatticeFirst = 0x2C1B3C6Du, kLatticeThen = 0x297A2D39u;  // in the two mixing steps
// Returns the hash of a lattice point. It is cheap: only its top four bits are used.
SELENOGRAPH_INTO_LANES inline std::uint32_t lattice_hash(std::int32_t x, std::int32_t y, std::int32_t z,
                                                         std::uint32_t seed) {
  std::uint32_t h = seed ^ (static_cast<std::uint32_t>(x) * kLatticeX) ^ (static_cast<std::uint32_t>(y) * kLatticeY) ^
                    (static_cast<std::uint32_t>(z) * kLatticeZ);
  h = (h ^ (h >> 15)) * kLatticeFirst;
  h = (h ^ (h >> 12)) * kLatticeThen;
  return h ^ (h >> 15);
}

// Returns the dot product with the direction to one of a cube's twelve edges, four of which have two numbers (Perlin
// 2002). It uses no table, so that compilers vectorise loops over lanes.
template <typename Real>
SELENOGRAPH_INTO_LANES inline Real along_gradient(std::uint32_t number, Real x, Real y, Real z) {
  number = number == 14 ? 9 : number;
  const bool again = (number & 14) == 12;
  const Real a = number < 8 || again ? x : y, b = number < 4 || again ? y : z;
  return (number & 1 ? -a : a) + (number & 2 ? -b : b);
}

// Interpolates linearly. std::lerp handles cases that do not occur here, at several times the cost.
template <typename Real>
SELENOGRAPH_INTO_LANES inline Real blend(Real a, Real b, Real t) {
  return a + t * (b - a);
}

// Rounds down. std::floor handles cases that do not occur here, at several times the cost.
SELENOGRAPH_INTO_LANES inline std::int32_t lattice_floor(double v) {
  const auto truncated = static_cast<std::int32_t>(v);
  return truncated - (v < truncated ? 1 : 0);
}

template <typename Real>
SELENOGRAPH_INTO_LANES inline Real noise_fade(Real t) {
  return t * t * t * (t * (t * 6 - 15) + 10);
}

// Returns gradient noise in three dimensions (Perlin 2002), of unit wavelength, within +-1.0364.
template <typename Real>
SELENOGRAPH_INTO_LANES inline Real perlin_noise(double x, double y, double z, std::uint32_t seed) {
  const std::int32_t i = lattice_floor(x), j = lattice_floor(y), k = lattice_floor(z);
  const Real fx = static_cast<Real>(x - i), fy = static_cast<Real>(y - j), fz = static_cast<Real>(z - k);
  const Real u = noise_fade(fx), v = noise_fade(fy), w = noise_fade(fz);
  const auto corner = [&](int di, int dj, int dk) SELENOGRAPH_INTO_LANES {
    return along_gradient<Real>(lattice_hash(i + di, j + dj, k + dk, seed) >> 28, fx - static_cast<Real>(di),
                                fy - static_cast<Real>(dj), fz - static_cast<Real>(dk));
  };
  const auto along_x = [&](int dj, int dk)
                           SELENOGRAPH_INTO_LANES { return blend(corner(0, dj, dk), corner(1, dj, dk), u); };
  return blend(blend(along_x(0, 0), along_x(1, 0), v), blend(along_x(0, 1), along_x(1, 1), v), w);
}

// Gradients at the corners of a cell of perlin_noise: corner di + 2 dj + 4 dk has components x, y, z of 0 or +-1.
struct NoiseCell {
  NoiseCell(std::int32_t i_, std::int32_t j_, std::int32_t k_, std::uint32_t seed) : i(i_), j(j_), k(k_) {
    for (int c = 0; c < 8; ++c) {
      const std::uint32_t number = lattice_hash(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2), seed) >> 28;
      x[c] = along_gradient<float>(number, 1, 0, 0);
      y[c] = along_gradient<float>(number, 0, 1, 0);
      z[c] = along_gradient<float>(number, 0, 0, 1);
    }
  }
  std::int32_t i, j, k;
  float x[8], y[8], z[8];
};

}  // namespace selenograph::dem
