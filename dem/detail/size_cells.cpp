#include "dem/detail/size_cells.h"

#include <limits>

#include "dem/base/hash.h"

namespace selenograph::dem {
namespace {

using std::numbers::pi;

// Limit of a cell's Poisson deviate, which it never reaches: even the densest laws expect some 4 members per cell. It
// ends the loop if rounding leaves a remainder.
constexpr int kMaxInCell = 4096;

}  // namespace

double SizeFrequency::above(double diameter_m) const {
  double minimum = std::numeric_limits<double>::infinity();
  for (const Power& law : laws) minimum = std::min(minimum, law.per_m2 * std::pow(diameter_m, -law.exponent));
  return laws.empty() ? 0 : minimum;
}

std::uint64_t Draws::bits() {
  ++key_.index;
  return hash_of(&key_, sizeof key_);
}

double Draws::normal() {
  const double a = uniform(), b = uniform();
  return std::sqrt(-2 * std::log(a)) * std::cos(2 * pi * b);
}

// Subtracts the probabilities of 0, 1, 2 .. from a uniform deviate until it is used up.
int Draws::poisson(double mean) {
  double left = uniform(), probability = std::exp(-mean);
  int n = 0;
  while (left > probability && n < kMaxInCell) {
    left -= probability;
    probability *= mean / ++n;
  }
  return n;
}

int SizeCells::Cells::columns(int row) const {
  const double max_cos_lat = std::cos(std::min(std::abs(south(row)), std::abs(south(row + 1))));
  return std::max(1, static_cast<int>(std::lround(2.0 * rows * max_cos_lat)));
}

int SizeCells::Cells::row_at(double latitude) const {
  return std::clamp(static_cast<int>(std::floor((latitude / pi + 0.5) * rows)), 0, rows - 1);
}

// Inverts the distribution function of the power law between both diameters.
double SizeCells::Cells::diameter_m(double uniform) const {
  const double share = 1 - std::pow(smallest_m / largest_m, exponent);
  return smallest_m * std::pow(1 - uniform * share, -1 / exponent);
}

// A cell's area on the unit sphere is its width in longitude times the difference of its sines of latitude.
double SizeCells::Cells::expected(int row) const {
  const double low = std::sin(south(row)), high = std::sin(south(row + 1)), width = 2 * pi / columns(row);
  return per_m2 * kMoonRadius_m * kMoonRadius_m * width * (high - low);
}

SizeCells::SizeCells(std::uint64_t seed, SizeFrequency frequency, double smallest_m, double largest_m,
                     double density_factor)
    : seed_(seed),
      frequency_(std::move(frequency)),
      smallest_m_(smallest_m),
      largest_m_(largest_m),
      density_factor_(density_factor),
      smallest_octave_(octave_of(smallest_m)),
      largest_octave_(static_cast<int>(std::ceil(std::log2(largest_m))) - 1) {}

// Lays out an octave's cells. A power law through the numbers above both diameters stands for the law in between.
SizeCells::Cells SizeCells::cells_of(int octave) const {
  Cells cells;
  cells.octave = octave;
  cells.rows = std::max(3, static_cast<int>(std::floor(pi * kMoonRadius_m / std::ldexp(kCellDiameters, octave))));
  cells.smallest_m = std::max(smallest_m_, std::ldexp(1.0, octave));
  cells.largest_m = largest_m(octave);
  if (cells.smallest_m >= cells.largest_m) return cells;
  const double above_smallest = frequency_.above(cells.smallest_m), above_largest = frequency_.above(cells.largest_m);
  cells.per_m2 = density_factor_ * (above_smallest - above_largest);
  cells.exponent = std::log(above_smallest / above_largest) / std::log(cells.largest_m / cells.smallest_m);
  return cells;
}

}  // namespace selenograph::dem
