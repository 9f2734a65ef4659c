#include "dem/detail/crater_field.h"

#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace selenograph::dem {
namespace {

using std::numbers::pi;

// A crater reaches 4.8 radii, so that those which reach a place are in its cell or in one beside it.
static_assert(CraterField::kCellDiameters > 4.8);
// Beyond what a Poisson number of a cell's mean ever is: at the densest laws some 4 are expected.
constexpr int kMostInCell = 4096;

// Numbers of a cell, one after the other.
class Draws {
 public:
  Draws(std::uint64_t seed, int octave, int row, int column) : key_{seed, octave, row, column, 0} {}
  std::uint64_t bits() {
    ++key_.index;
    return XXH3_64bits(&key_, sizeof key_);
  }
  // In (0, 1).
  double uniform() { return (static_cast<double>(bits() >> 11) + 0.5) * 0x1p-53; }
  // Two of these are a standard normal (Box & Muller 1958).
  double normal() {
    const double a = uniform(), b = uniform();
    return std::sqrt(-2 * std::log(a)) * std::cos(2 * pi * b);
  }
  // By the inverse of its distribution function.
  int poisson(double mean) {
    double left = uniform(), probability = std::exp(-mean);
    int n = 0;
    while (left > probability && n < kMostInCell) {
      left -= probability;
      probability *= mean / ++n;
    }
    return n;
  }

 private:
  struct Key {
    std::uint64_t seed;
    std::int32_t octave, row, column;
    std::uint32_t index;
  } key_;
  static_assert(sizeof(Key) == 24);  // no padding: all of it is hashed
};

}  // namespace

double SizeFrequency::above(double diameter_m) const {
  double fewest = std::numeric_limits<double>::infinity();
  for (const Power& law : laws) fewest = std::min(fewest, law.per_m2 * std::pow(diameter_m, -law.exponent));
  return laws.empty() ? 0 : fewest;
}

SizeFrequency equilibrium() { return {{{std::pow(10, -1.1), 2}}}; }

double fresh_depth_over_diameter(double diameter_m) {
  struct Median {
    double diameter_m, ratio;
  };
  static constexpr std::array<Median, 5> kMedians{{{10, 0.11}, {40, 0.13}, {100, 0.15}, {200, 0.17}, {400, 0.21}}};
  const auto above =
      std::find_if(kMedians.begin(), kMedians.end(), [&](const Median& m) { return m.diameter_m > diameter_m; });
  if (above == kMedians.end()) return kMedians.back().ratio;
  // "less below": by the slope between 10 and 40 m, and no less than 0.08.
  const Median& high = above == kMedians.begin() ? kMedians[1] : *above;
  const Median& low = above == kMedians.begin() ? kMedians[0] : *(above - 1);
  const double share = std::log(diameter_m / low.diameter_m) / std::log(high.diameter_m / low.diameter_m);
  return std::max(0.08, low.ratio + share * (high.ratio - low.ratio));
}

struct CraterField::Cells {
  int octave = 0, rows = 0;
  double smallest_m = 0, largest_m = 0;  // of the octave, within the law's
  double per_m2 = 0;
  double exponent = 0;  // of the power law between the two

  double south(int row) const { return (static_cast<double>(row) / rows - 0.5) * pi; }
  int columns(int row) const {
    const double widest = std::cos(std::min(std::abs(south(row)), std::abs(south(row + 1))));
    return std::max(1, static_cast<int>(std::lround(2.0 * rows * widest)));
  }
  int row_at(double latitude) const {
    return std::clamp(static_cast<int>(std::floor((latitude / pi + 0.5) * rows)), 0, rows - 1);
  }
};

CraterField::CraterField(const CraterLaw& law)
    : law_(law),
      smallest_octave_(static_cast<int>(std::floor(std::log2(law.smallest_m)))),
      largest_octave_(static_cast<int>(std::ceil(std::log2(law.largest_m))) - 1) {}

CraterField::Cells CraterField::cells_of(int octave) const {
  Cells cells;
  cells.octave = octave;
  cells.rows =
      std::max(3, static_cast<int>(std::floor(pi * kMoonRadius_m / std::ldexp(CraterField::kCellDiameters, octave))));
  cells.smallest_m = std::max(law_.smallest_m, std::ldexp(1.0, octave));
  cells.largest_m = std::min(law_.largest_m, std::ldexp(2.0, octave));
  if (cells.smallest_m >= cells.largest_m) return cells;
  const double more = law_.frequency.above(cells.smallest_m), fewer = law_.frequency.above(cells.largest_m);
  cells.per_m2 = more - fewer;
  cells.exponent = std::log(more / fewer) / std::log(cells.largest_m / cells.smallest_m);
  return cells;
}

void CraterField::draw(const Cells& cells, int row, int column, std::vector<Crater>& out) const {
  const int columns = cells.columns(row);
  const double low = std::sin(cells.south(row)), high = std::sin(cells.south(row + 1)), width = 2 * pi / columns;
  Draws draws(law_.seed, cells.octave, row, column);
  const int n = draws.poisson(cells.per_m2 * kMoonRadius_m * kMoonRadius_m * width * (high - low));
  for (int i = 0; i < n; ++i) {
    Crater crater;
    const double z = low + draws.uniform() * (high - low), longitude = (column + draws.uniform()) * width - pi;
    const double around = std::sqrt(std::max(0.0, 1 - z * z));
    crater.centre = {around * std::cos(longitude), around * std::sin(longitude), z};
    const double share = 1 - std::pow(cells.smallest_m / cells.largest_m, cells.exponent);
    crater.diameter_m = cells.smallest_m * std::pow(1 - draws.uniform() * share, -1 / cells.exponent);
    const double radius2 = crater.diameter_m * crater.diameter_m / 4;
    const double until_Ma = std::min(law_.oldest_Ma, CraterShape::kOldest * radius2 / law_.diffusivity_m2_per_Ma);
    crater.age_Ma = draws.uniform() * until_Ma;
    crater.age = law_.diffusivity_m2_per_Ma * crater.age_Ma / radius2;
    // Within three standard deviations: what is reported as the deepest is.
    const double ratio =
        fresh_depth_over_diameter(crater.diameter_m) + kDepthScatter * std::clamp(draws.normal(), -3.0, 3.0);
    crater.scale = crater.diameter_m * std::max(0.0, ratio) / CraterShape::kFreshDepth;
    crater.depth_m = crater.diameter_m * std::max(0.0, ratio) * shape_.depth_left(crater.age);
    crater.id = draws.bits();
    out.push_back(crater);
  }
}

void CraterField::draw_row(const Cells& cells, int row, int first, int last, std::vector<Crater>& out) const {
  const int columns = cells.columns(row), most = std::min(last - first + 1, columns);
  for (int i = 0; i < most; ++i) draw(cells, row, ((first + i) % columns + columns) % columns, out);
}

void CraterField::near(int octave, const Vec3& direction, double radius_m, std::vector<Crater>& out) const {
  const Cells cells = cells_of(octave);
  if (!(cells.per_m2 > 0)) return;
  const double reach_m = CraterShape::reach(CraterShape::kOldest) * cells.largest_m / 2;
  const double angle = (radius_m + reach_m) / kMoonRadius_m;
  const double latitude = std::asin(std::clamp(direction.z(), -1.0, 1.0)),
               longitude = std::atan2(direction.y(), direction.x());
  std::vector<Crater> some;
  for (int row = cells.row_at(latitude - angle); row <= cells.row_at(latitude + angle); ++row) {
    const int columns = cells.columns(row);
    // Half of the longitudes that a cap covers at most: everything where it holds a pole.
    const double away = std::abs(latitude) + angle;
    const double half = away >= pi / 2 ? pi : std::asin(std::min(1.0, std::sin(angle) / std::cos(latitude)));
    const double place = (longitude + pi) / (2 * pi) * columns, reach = half / (2 * pi) * columns;
    const auto first = static_cast<int>(std::floor(place - reach)), last = static_cast<int>(std::floor(place + reach));
    draw_row(cells, row, first, last, some);
  }
  for (const Crater& crater : some)
    if ((crater.centre - direction).norm() * kMoonRadius_m <= radius_m + crater.reach_m()) out.push_back(crater);
}

std::vector<Crater> CraterField::within(int octave, double south_deg, double north_deg, double west_deg,
                                        double east_deg) const {
  const Cells cells = cells_of(octave);
  std::vector<Crater> out;
  if (!(cells.per_m2 > 0)) return out;
  std::vector<Crater> some;
  for (int row = cells.row_at(south_deg * kRadiansPerDegree); row <= cells.row_at(north_deg * kRadiansPerDegree);
       ++row) {
    const int columns = cells.columns(row);
    const auto column_at = [&](double lon_deg) {
      return static_cast<int>(std::floor((lon_deg + 180) / 360 * columns));
    };
    draw_row(cells, row, column_at(west_deg), column_at(east_deg), some);
  }
  for (const Crater& crater : some) {
    const Geographic g = to_geographic(crater.centre * kMoonRadius_m);
    const double east = g.lon_deg + 360 * std::ceil((west_deg - g.lon_deg) / 360);
    if (g.lat_deg >= south_deg && g.lat_deg <= north_deg && east <= east_deg) out.push_back(crater);
  }
  return out;
}

double CraterField::deepest_m(int octave) const {
  const Cells cells = cells_of(octave);
  return cells.largest_m * (fresh_depth_over_diameter(cells.largest_m) + 3 * kDepthScatter) * 0.228809953 /
         CraterShape::kFreshDepth;
}

double CraterField::highest_m(int octave) const {
  const Cells cells = cells_of(octave);
  return cells.largest_m * (fresh_depth_over_diameter(cells.largest_m) + 3 * kDepthScatter) * 0.036822095 /
         CraterShape::kFreshDepth;
}

}  // namespace selenograph::dem
