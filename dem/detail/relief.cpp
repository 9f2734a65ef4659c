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

// Proven bound on the absolute value of gradient noise with the twelve gradients to a cube's edges, and rounding.
constexpr double kMaxNoise = 1.0363538112118025 + 1e-5;

// Returns the structure function of the noise: its mean squared difference between points at each of the distances, in
// cells. Positions and directions come from an additive recurrence: evenly spread, and the same on every machine.
std::vector<double> structure_function(const std::vector<double>& distances) {
  constexpr std::size_t kPairs = 4096;
  struct Pair {
    Vec3 position, direction;
    double noise;  // at the position
  };
  const auto noise = [](const Vec3& p) { return perlin_noise<double>(p.x(), p.y(), p.z(), 1); };
  std::vector<Pair> pairs;
  pairs.reserve(kPairs);
  for (std::size_t i = 0; i < kPairs; ++i) {
    // Returns number i of an additive recurrence in [0, 1).
    const auto fraction = [&](double step) {
      const double sum = 0.5 + static_cast<double>(i) * step;
      return sum - std::floor(sum);
    };
    const Vec3 position(64 * fraction(0.8191725133961645), 64 * fraction(0.6710436067037893),
                        64 * fraction(0.5497004779019703));
    const double z = 2 * fraction(0.4503) - 1, azimuth = 2 * std::numbers::pi * fraction(0.36889),
                 horizontal = std::sqrt(1 - z * z);
    pairs.push_back({position, {horizontal * std::cos(azimuth), horizontal * std::sin(azimuth), z}, noise(position)});
  }
  std::vector<double> squares(distances.size());
  in_parallel(distances.size(), [&](std::size_t k) {
    double sum = 0;
    for (const Pair& pair : pairs) {
      const double d = noise(pair.position + distances[k] * pair.direction) - pair.noise;
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
      longest_(static_cast<int>(std::floor(std::log2(law.longest_m)))),
      hurst_(law.hurst),
      min_factor_(law.min_factor),
      fine_below_m_(law.fine.below_m) {
  // Fit unit_m, the amplitude of the octave of 1 m, so that the sum of all octaves has the law's deviation at its
  // baseline. Sum over octaves shorter and longer than those made, too: the published deviation is that of the ground
  // with all its wavelengths, not of the octaves that this object makes.
  constexpr int kOctavesAround = 8;
  const int at_baseline = static_cast<int>(std::lround(std::log2(law.baseline_m)));
  std::vector<double> distances;
  for (int k = at_baseline - kOctavesAround - 1; k <= at_baseline + kOctavesAround; ++k)
    distances.push_back(law.baseline_m / std::ldexp(1.0, k));
  const std::vector<double> squares = structure_function(distances);
  double sum = 0, second_sum = 0;  // squared differences, and squared second differences, for unit_m = 1
  for (std::size_t i = 1; i < squares.size(); ++i) {
    const double octave_square = std::pow(4, (at_baseline - kOctavesAround - 1 + static_cast<int>(i)) * law.hurst);
    sum += octave_square * squares[i];
    second_sum += octave_square * (4 * squares[i] - squares[i - 1]);  // before: the structure function at 2 d
  }
  const double unit_m = sum > 0 ? law.deviation_m / std::sqrt(sum) : 0;
  second_difference_of_1_m_ = unit_m * std::sqrt(second_sum) * std::pow(law.baseline_m, -law.hurst);
  // Approximate the noise's RMS slope, per cell, by differences over a thousandth of a cell.
  constexpr double kShort = 1e-3;
  const double unit_slope = law.fine.below_m > 0 ? std::sqrt(structure_function({kShort}).front()) / kShort : 1;
  for (int k = shortest_; k <= longest_; ++k) {
    const double wavelength_m = std::ldexp(1.0, k);
    if (wavelength_m >= law.fine.below_m) {
      amplitudes_m_.push_back(unit_m * std::pow(2, k * law.hurst));
      continue;
    }
    // The RMS slope of an octave scales as its wavelength to the power of H - 1.
    const double slope = law.fine.slope * std::pow(wavelength_m / (law.fine.below_m / 2), law.fine.hurst - 1);
    amplitudes_m_.push_back(slope * wavelength_m / unit_slope);
  }
}

double Relief::amplitude_m(int octave) const { return amplitudes_m_[static_cast<std::size_t>(octave - shortest_)]; }

// Second differences of self-affine ground grow with the distance as its deviations do.
double Relief::second_difference_m(double distance_m) const {
  return second_difference_of_1_m_ * std::pow(distance_m, hurst_);
}

double Relief::max_height_m(int octave) const { return kMaxNoise * amplitude_m(octave); }

// Evaluates noise in the Moon's body axes, scaled so that a cell of its lattice is one wavelength wide.
void Relief::add_row(int octave, const DirectionGrid& grid, std::size_t row, std::span<double> heights_m) const {
  constexpr std::size_t kChunk = 128;  // columns per call of the kernel
  std::array<double, kChunk> x, y;
  const double radius_cells = kMoonRadius_m * std::ldexp(1.0, -octave),
               row_radius_cells = grid.cos_lat[row] * radius_cells;
  // Derive a seed for each octave, so that octaves are independent although their lattices share every second point.
  const auto seed =
      static_cast<std::uint32_t>(split_mix(seed_ + kSplitMixStep * static_cast<std::uint64_t>(octave + 64)) >> 32);
  for (std::size_t first = 0; first < grid.columns(); first += kChunk) {
    const std::size_t n = std::min(kChunk, grid.columns() - first);
    for (std::size_t c = 0; c < n; ++c) {
      x[c] = row_radius_cells * grid.cos_lon[first + c];
      y[c] = row_radius_cells * grid.sin_lon[first + c];
    }
    add_noise({x.data(), y.data(), grid.sin_lat[row] * radius_cells, n}, seed, amplitude_m(octave),
              heights_m.data() + first);
  }
}

}  // namespace selenograph::dem
