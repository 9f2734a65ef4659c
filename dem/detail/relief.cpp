#include "dem/detail/relief.h"

#include <algorithm>
#include <cmath>

#include "dem/noise.h"

namespace selenograph::dem {
namespace {

// Gradient noise of the twelve directions to a cube's edges is within this (its proven bound).
constexpr double kMostNoise = 1.0363538112118025;

double noise(std::uint64_t seed, double x, double y, double z) {
  return perlin_noise(x, y, z, [seed](std::int64_t i, std::int64_t j, std::int64_t k) {
    const std::uint64_t a = split_mix(seed + kSplitMixStep * static_cast<std::uint64_t>(i));
    const std::uint64_t b = split_mix(a + kSplitMixStep * static_cast<std::uint64_t>(j));
    return static_cast<std::uint32_t>(split_mix(b + kSplitMixStep * static_cast<std::uint64_t>(k)) >> 60);
  });
}

// Mean squared difference of the noise between places `distance` cells apart.
double structure(double distance) {
  if (distance == 0) return 0;
  constexpr int kPairs = 4096;
  double sum = 0;
  for (int i = 0; i < kPairs; ++i) {
    // Places and directions by an additive recurrence: even, and the same on every machine.
    const auto part = [&](double step) { return std::fmod(0.5 + i * step, 1.0); };
    const double x = 64 * part(0.8191725133961645), y = 64 * part(0.6710436067037893),
                 z = 64 * part(0.5497004779019703);
    const double up = 2 * part(0.4503) - 1, turn = 2 * M_PI * part(0.36889), flat = std::sqrt(1 - up * up);
    const double d =
        noise(1, x + distance * flat * std::cos(turn), y + distance * flat * std::sin(turn), z + distance * up) -
        noise(1, x, y, z);
    sum += d * d;
  }
  return sum / kPairs;
}

}  // namespace

Relief::Relief(const ReliefLaw& law)
    : seed_(law.seed),
      shortest_(static_cast<int>(std::ceil(std::log2(law.shortest_m)))),
      longest_(static_cast<int>(std::floor(std::log2(law.longest_m)))) {
  // An octave of 2^k m has the amplitude unit * 2^(k H).
  double sum = 0;
  // Those shorter and longer than the law's, too: it says what all of the relief does, not what part of it is made.
  const int at_baseline = static_cast<int>(std::lround(std::log2(law.baseline_m)));
  for (int k = at_baseline - 8; k <= at_baseline + 8; ++k)
    sum += std::pow(4, k * law.hurst) * structure(law.baseline_m / std::ldexp(1.0, k));
  const double unit_m = sum > 0 ? law.deviation_m / std::sqrt(sum) : 0;
  for (int k = shortest_; k <= longest_; ++k) amplitudes_m_.push_back(unit_m * std::pow(2, k * law.hurst));
}

double Relief::amplitude_m(int octave) const { return amplitudes_m_[static_cast<std::size_t>(octave - shortest_)]; }

double Relief::most_m(int octave) const { return kMostNoise * amplitude_m(octave); }

double Relief::height_m(int octave, const Vec3& direction) const {
  const Vec3 p = direction * (kMoonRadius_m * std::ldexp(1.0, -octave));
  // Octaves of one seed would have the same gradients around the Moon's centre alone, but neighbours' lattices
  // coincide.
  return amplitude_m(octave) *
         noise(seed_ + 0x632be59bd9b4e019ULL * static_cast<std::uint64_t>(octave + 64), p.x(), p.y(), p.z());
}

}  // namespace selenograph::dem
