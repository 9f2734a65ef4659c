#include "dem/detail/relief.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "dem/base/noise.h"
#include "dem/base/parallel.h"
#include "dem/detail/detail_kernels.h"

namespace selenograph::dem {
namespace {

// Gradient noise of the twelve directions to a cube's edges is within this (its proven bound), but for rounding.
constexpr double kMostNoise = 1.0363538112118025 + 1e-5;

// Mean squared differences of the noise between places some distances apart, in cells. Places and directions by an
// additive recurrence: even, and the same on every machine.
std::vector<double> structure(const std::vector<double>& distances) {
  constexpr std::size_t kPairs = 4096;
  struct Pair {
    Vec3 here, away;
    double noise;
  };
  const auto noise = [](const Vec3& p) { return perlin_noise<double>(p.x(), p.y(), p.z(), 1); };
  std::vector<Pair> pairs;
  pairs.reserve(kPairs);
  for (std::size_t i = 0; i < kPairs; ++i) {
    const auto part = [&](double step) {
      const double place = 0.5 + static_cast<double>(i) * step;
      return place - std::floor(place);
    };
    const Vec3 here(64 * part(0.8191725133961645), 64 * part(0.6710436067037893), 64 * part(0.5497004779019703));
    const double up = 2 * part(0.4503) - 1, turn = 2 * std::numbers::pi * part(0.36889), flat = std::sqrt(1 - up * up);
    pairs.push_back({here, {flat * std::cos(turn), flat * std::sin(turn), up}, noise(here)});
  }
  std::vector<double> squares(distances.size());
  in_parallel(distances.size(), [&](std::size_t k) {
    double sum = 0;
    for (const Pair& pair : pairs) {
      const double d = noise(pair.here + distances[k] * pair.away) - pair.noise;
      sum += d * d;
    }
    squares[k] = sum / kPairs;
  });
  return squares;
}

}  // namespace

Relief::Relief(const ReliefLaw& law)
    : seed_(law.seed),
      shortest_(static_cast<int>(std::ceil(std::log2(law.shortest_m)))),
      longest_(static_cast<int>(std::floor(std::log2(law.longest_m)))) {
  // An octave of 2^k m has the amplitude unit * 2^(k H).
  // Those shorter and longer than the law's, too: it says what all of the relief does, not what part of it is made.
  constexpr int kAround = 8;
  const int at_baseline = static_cast<int>(std::lround(std::log2(law.baseline_m)));
  std::vector<double> distances;
  for (int k = at_baseline - kAround; k <= at_baseline + kAround; ++k)
    distances.push_back(law.baseline_m / std::ldexp(1.0, k));
  const std::vector<double> squares = structure(distances);
  double sum = 0;
  for (std::size_t i = 0; i < squares.size(); ++i)
    sum += std::pow(4, (at_baseline - kAround + static_cast<int>(i)) * law.hurst) * squares[i];
  const double unit_m = sum > 0 ? law.deviation_m / std::sqrt(sum) : 0;
  for (int k = shortest_; k <= longest_; ++k) amplitudes_m_.push_back(unit_m * std::pow(2, k * law.hurst));
}

double Relief::amplitude_m(int octave) const { return amplitudes_m_[static_cast<std::size_t>(octave - shortest_)]; }

double Relief::most_m(int octave) const { return kMostNoise * amplitude_m(octave); }

void Relief::add_row(int octave, const DirectionGrid& grid, std::size_t row, std::span<double> heights_m) const {
  constexpr std::size_t kPiece = 128;
  std::array<double, kPiece> x, y;
  const double per_wavelength = kMoonRadius_m * std::ldexp(1.0, -octave), around = grid.cos_lat[row] * per_wavelength;
  // Octaves of one seed would have the same gradients around the Moon's centre alone, but neighbours' lattices
  // coincide.
  const auto seed =
      static_cast<std::uint32_t>(split_mix(seed_ + kSplitMixStep * static_cast<std::uint64_t>(octave + 64)) >> 32);
  for (std::size_t first = 0; first < grid.columns(); first += kPiece) {
    const std::size_t n = std::min(kPiece, grid.columns() - first);
    for (std::size_t c = 0; c < n; ++c)
      x[c] = around * grid.cos_lon[first + c], y[c] = around * grid.sin_lon[first + c];
    add_noise({x.data(), y.data(), grid.sin_lat[row] * per_wavelength, n}, seed, amplitude_m(octave),
              heights_m.data() + first);
  }
}

}  // namespace selenograph::dem
