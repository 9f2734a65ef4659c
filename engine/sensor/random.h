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
  lidar = 2           // beams of a lidar: "frame" is a scan and a purpose, "pixel" a beam
};

inline constexpr int kDraw = 64;  // pixels per call

// Four words of 32 random bits for each of kDraw pixels from `pixel` on: words[word][pixel].
struct RandomWords {
  alignas(64) std::uint32_t word[4][kDraw];
};
void draw(std::uint64_t seed, std::uint64_t frame, RandomSource source, std::uint32_t pixel, RandomWords& out);

// Converts bits to standard normal deviates by the inverse of the distribution function (Wichura, AS 241, PPND7, Appl.
// Statist. 37, 477, 1988): to 1e-6 of the probability in either tail, within 6.3 standard deviations.
void normals(const std::uint32_t bits[kDraw], float out[kDraw]);

// Converts bits to Poisson deviates by the inverse of the distribution function: exact below a mean of kExactPoisson,
// above it by the asymptotic expansion of Giles (ACM TOMS 42(1), 7, 2016, eq. 7), whose probabilities are within 5e-5.
// Means of 0 and less give 0.
inline constexpr float kExactPoisson = 10;
void poisson(const std::uint32_t bits[kDraw], const float mean[kDraw], float out[kDraw]);

// Return the same numbers for a single pixel, where kDraw of them are not needed.
using RandomBits = std::array<std::uint32_t, 4>;
RandomBits draw_one(std::uint64_t seed, std::uint64_t frame, RandomSource source, std::uint32_t pixel);
float normal_one(std::uint32_t bits);
float poisson_one(std::uint32_t bits, float mean);

}  // namespace selenograph::engine
