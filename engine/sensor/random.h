// Random numbers as functions of their position: there is no sequence, so any thread may compute any of them. Bits from
// Philox4x32-10 (Salmon, Moraes, Dror, Shaw: Parallel random numbers: as easy as 1, 2, 3, SC'11). Every operation is
// exact or IEEE-rounded, so the bytes are the same on every machine.
#pragma once

#include <array>
#include <cstdint>

namespace selenograph::engine {

enum class RandomSource : std::uint32_t {
  exposure = 0,       // different in every frame: photon and read noise
  fixed_pattern = 1,  // the same in every frame
  lidar = 2           // of a lidar's beams: a frame is a scan and a purpose, a pixel a beam
};

inline constexpr int kDraw = 64;  // pixels at a time

// Four words of 32 random bits for each of kDraw pixels from `pixel` on: words[word][pixel].
struct RandomWords {
  alignas(64) std::uint32_t word[4][kDraw];
};
void draw(std::uint64_t seed, std::uint64_t frame, RandomSource source, std::uint32_t pixel, RandomWords& out);

// Standard normal deviates by the inverse of the distribution function (Wichura, AS 241, PPND7, Appl. Statist. 37, 477,
// 1988): to 1e-6 of the probability in either tail, within 6.3 standard deviations.
void normals(const std::uint32_t bits[kDraw], float out[kDraw]);

// Poisson deviates by the inverse of the distribution function: exact below a mean of kExactPoisson, above it by the
// asymptotic expansion of Giles (ACM TOMS 42(1), 7, 2016, eq. 7), whose probabilities are within 5e-5. 0 for means of 0
// and less.
inline constexpr float kExactPoisson = 10;
void poisson(const std::uint32_t bits[kDraw], const float mean[kDraw], float out[kDraw]);

// The same numbers one at a time, where a draw for the next pixels would be for nothing.
using RandomBits = std::array<std::uint32_t, 4>;
RandomBits draw_one(std::uint64_t seed, std::uint64_t frame, RandomSource source, std::uint32_t pixel);
float normal_one(std::uint32_t bits);
float poisson_one(std::uint32_t bits, float mean);

}  // namespace selenograph::engine
