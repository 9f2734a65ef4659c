#include "dem/detail/relief.h"

#include <algorithm>
#include <cmath>

namespace selenograph::dem {
namespace {

// Gradient noise of the twelve directions to a cube's edges is within this (its proven bound).
constexpr double kMostNoise = 1.0363538112118025;

std::uint64_t mixed(std::uint64_t x) {  // SplitMix64's finalizer (Steele, Lea, Flood 2014)
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

std::uint64_t hash_of(std::uint64_t seed, std::int64_t x, std::int64_t y, std::int64_t z) {
  const std::uint64_t a = mixed(seed + 0x9e3779b97f4a7c15ULL * static_cast<std::uint64_t>(x));
  const std::uint64_t b = mixed(a + 0x9e3779b97f4a7c15ULL * static_cast<std::uint64_t>(y));
  return mixed(b + 0x9e3779b97f4a7c15ULL * static_cast<std::uint64_t>(z));
}

double along_gradient(std::uint64_t hash, double x, double y, double z) {
  // The sixteenths repeat four of the twelve, as in Perlin's.
  switch (hash >> 60) {
    case 0:
    case 12:
      return x + y;
    case 1:
    case 14:
      return -x + y;
    case 2:
      return x - y;
    case 3:
      return -x - y;
    case 4:
      return x + z;
    case 5:
      return -x + z;
    case 6:
      return x - z;
    case 7:
      return -x - z;
    case 8:
      return y + z;
    case 9:
    case 13:
      return -y + z;
    case 10:
      return y - z;
    default:
      return -y - z;
  }
}

double noise(std::uint64_t seed, double x, double y, double z) {
  const double bx = std::floor(x), by = std::floor(y), bz = std::floor(z);
  const double fx = x - bx, fy = y - by, fz = z - bz;
  const auto ix = static_cast<std::int64_t>(bx), iy = static_cast<std::int64_t>(by), iz = static_cast<std::int64_t>(bz);
  const auto fade = [](double t) { return t * t * t * (t * (t * 6 - 15) + 10); };
  const auto mix = [](double t, double a, double b) { return a + t * (b - a); };
  const auto corner = [&](int i, int j, int k) {
    return along_gradient(hash_of(seed, ix + i, iy + j, iz + k), fx - i, fy - j, fz - k);
  };
  const double u = fade(fx), v = fade(fy), w = fade(fz);
  return mix(w, mix(v, mix(u, corner(0, 0, 0), corner(1, 0, 0)), mix(u, corner(0, 1, 0), corner(1, 1, 0))),
             mix(v, mix(u, corner(0, 0, 1), corner(1, 0, 1)), mix(u, corner(0, 1, 1), corner(1, 1, 1))));
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
    : law_(law),
      shortest_(static_cast<int>(std::ceil(std::log2(law.shortest_m)))),
      longest_(static_cast<int>(std::floor(std::log2(law.longest_m)))) {
  // An octave of 2^k m has the amplitude unit * 2^(k H).
  double sum = 0;
  // Those shorter and longer than the law's, too: it says what all of the relief does, not what part of it is made.
  const int at_baseline = static_cast<int>(std::lround(std::log2(law.baseline_m)));
  for (int k = at_baseline - 8; k <= at_baseline + 8; ++k)
    sum += std::pow(4, k * law.hurst) * structure(law.baseline_m / std::ldexp(1.0, k));
  unit_m_ = sum > 0 ? law.deviation_m / std::sqrt(sum) : 0;
}

double Relief::amplitude_m(int octave) const { return unit_m_ * std::pow(2, octave * law_.hurst); }

double Relief::most_m(int octave) const { return kMostNoise * amplitude_m(octave); }

double Relief::height_m(int octave, const Vec3& direction) const {
  const Vec3 p = direction * (kMoonRadius_m * std::ldexp(1.0, -octave));
  // Octaves of one seed would have the same gradients around the Moon's centre alone, but neighbours' lattices
  // coincide.
  return amplitude_m(octave) *
         noise(law_.seed + 0x632be59bd9b4e019ULL * static_cast<std::uint64_t>(octave + 64), p.x(), p.y(), p.z());
}

}  // namespace selenograph::dem
