// A population whose sizes follow a law, generated from positions: craters, rocks. There is no global random sequence,
// so that any block, tile, thread and process finds the same members.
//
// Members are grouped by octaves of diameter, [2^k, 2^(k+1)) m, and each octave is drawn in its own cells: rings of
// latitude, divided into cells of nearly equal width. The number of members of a cell is Poisson distributed; its mean
// is the cell's area times the law's density.
//
//   row r+1  |     |     |     |     |        fewer columns towards a pole
//            +---+-+--+--+-+---+-----+
//   row r    | o |    |  o |   |     |        key (seed, octave, row, column, index) --hash--> draws of one cell:
//            +---+----+----+---+-----+        number of members, then position and size of each
//   side: 8 x 2^k m
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <tuple>
#include <vector>

#include "dem/base/noise.h"
#include "dem/base/stop_token.h"
#include "dem/files/raster_info.h"
#include "dem/grid/geodesy.h"

namespace selenograph::dem {

// Cumulative number of members above a diameter, per m^2: the minimum of several power laws, each
// `per_m2 (D / 1 m)^-exponent`.
struct SizeFrequency {
  struct Power {
    double per_m2 = 0, exponent = 0;
  };
  std::vector<Power> laws;
  double above(double diameter_m) const;
  // Returns the number between two diameters; 0 unless the first is smaller.
  double between(double smallest_m, double largest_m) const {
    return smallest_m < largest_m ? above(smallest_m) - above(largest_m) : 0;
  }
};

// Sorts features by diameter (member() has a diameter and an id), largest first, without duplicates.
template <typename Feature>
std::vector<Feature> largest_first(std::vector<Feature> found) {
  const auto key = [](const Feature& f) { return std::tuple(-f.member().diameter_m, f.member().id); };
  std::sort(found.begin(), found.end(), [&](const Feature& a, const Feature& b) { return key(a) < key(b); });
  const auto same = [&](const Feature& a, const Feature& b) { return key(a) == key(b); };
  found.erase(std::unique(found.begin(), found.end(), same), found.end());
  return found;
}

// Returns k with 2^k <= diameter_m < 2^(k+1).
inline int octave_of(double diameter_m) { return static_cast<int>(std::floor(std::log2(diameter_m))); }

// Sequence of random numbers of one cell, by hashing the cell and a counter.
class Draws {
 public:
  Draws(std::uint64_t seed, int octave, int row, int column) : key_{seed, octave, row, column, 0} {}
  std::uint64_t bits();
  // Uniform in (0, 1).
  double uniform() { return (static_cast<double>(bits() >> 11) + 0.5) * 0x1p-53; }
  // Standard normal deviate (Box & Muller 1958).
  double normal();
  // Poisson deviate by the inverse of the distribution function.
  int poisson(double mean);

 private:
  struct Key {
    std::uint64_t seed;
    std::int32_t octave, row, column;
    std::uint32_t index;
  } key_;
  static_assert(sizeof(Key) == 24);  // no padding bytes: the hash covers the object's memory
};

// Means over lumps on the ground whose shapes are drawn from seeds: their area over size^2 and their volume over
// size^3. Shape(seed).height(east, north) is the height at an offset from the centre, all in sizes; 0 beyond the lump,
// which lies within half a size. Takes some milliseconds.
struct MeanLump {
  double area = 0, volume = 0;
};
template <typename Shape>
MeanLump measure_lumps() {
  constexpr int kShapes = 512, kSteps = 24;
  MeanLump mean;
  for (int n = 0; n < kShapes; ++n) {
    const Shape shape(static_cast<std::uint64_t>(n) * kSplitMixStep);
    for (int i = 0; i < kSteps; ++i)
      for (int j = 0; j < kSteps; ++j) {
        const auto offset = [](int step) { return static_cast<float>((step + 0.5) / kSteps - 0.5); };
        const float height = shape.height(offset(i), offset(j));
        mean.area += height > 0;
        mean.volume += static_cast<double>(height);
      }
  }
  constexpr double kSamples = double{kShapes} * kSteps * kSteps;
  return {mean.area / kSamples, mean.volume / kSamples};
}

// Thread-safe: const functions may be called concurrently.
class SizeCells {
 public:
  // A cell's side over the octave's smallest diameter.
  static constexpr double kCellDiameters = 8;

  // Equal diameters: no members. Densities are the law's multiplied by `density_factor`.
  SizeCells(std::uint64_t seed, SizeFrequency frequency, double smallest_m, double largest_m,
            double density_factor = 1);

  // Octaves that have members: diameters from 2^k to 2^(k+1) m, limited to the given range.
  int smallest_octave() const { return smallest_octave_; }
  int largest_octave() const { return largest_octave_; }
  double largest_m(int octave) const { return std::min(largest_m_, std::ldexp(2.0, octave)); }

  // Calls make(draws, centre, diameter_m) for each member of an octave in the cells that touch a box; includes members
  // slightly outside. The centre is a unit vector. `east_deg` may exceed 180.
  template <typename Make>
  void in_box(int octave, const Footprint& box, const StopToken& stop, const Make& make) const;

  struct Cell {
    int octave, row, column;
    friend bool operator==(const Cell&, const Cell&) = default;
  };
  // Calls visit(cell) for the cells that touch a cap around a direction.
  template <typename Visit>
  void cells_near(int octave, const Vec3& direction, double angle_rad, const StopToken& stop, const Visit& visit) const;
  // Calls make(draws, centre, diameter_m) for each member of a cell.
  template <typename Make>
  void draw_cell(const Cell& cell, const Make& make) const {
    draw(cells_of(cell.octave), cell.row, cell.column, make);
  }

 private:
  // Layout and density of one octave's cells.
  struct Cells {
    int octave = 0, rows = 0;
    double smallest_m = 0, largest_m = 0;  // diameters of the octave, limited to the population's range
    double per_m2 = 0;                     // number of members per m^2
    double exponent = 0;                   // power law through the numbers at both diameters

    // Returns the latitude of a row's southern border, radians.
    double south(int row) const { return (static_cast<double>(row) / rows - 0.5) * std::numbers::pi; }
    int columns(int row) const;
    int row_at(double latitude) const;
    // Transforms a uniform deviate into a diameter by the power law.
    double diameter_m(double uniform) const;
    // Returns the expected number in each cell of a row.
    double expected(int row) const;
  };
  Cells cells_of(int octave) const;
  template <typename Make>
  void draw(const Cells& cells, int row, int column, const Make& make) const;
  // Visits the columns first..last, which may continue past the last column around the Moon; each cell once.
  template <typename Visit>
  static void visit_row(const Cells& cells, int row, int first, int last, const StopToken& stop, const Visit& visit);

  std::uint64_t seed_;
  SizeFrequency frequency_;
  double smallest_m_, largest_m_, density_factor_;
  int smallest_octave_, largest_octave_;
};

template <typename Make>
void SizeCells::draw(const Cells& cells, int row, int column, const Make& make) const {
  const double low = std::sin(cells.south(row)), high = std::sin(cells.south(row + 1)),
               width = 2 * std::numbers::pi / cells.columns(row);
  Draws draws(seed_, cells.octave, row, column);
  const int n = draws.poisson(cells.expected(row));
  for (int i = 0; i < n; ++i) {
    const double z = low + draws.uniform() * (high - low),
                 longitude = (column + draws.uniform()) * width - std::numbers::pi;
    const double cos_lat = std::sqrt(std::max(0.0, 1 - z * z));
    const double diameter_m = cells.diameter_m(draws.uniform());
    make(draws, Vec3(cos_lat * std::cos(longitude), cos_lat * std::sin(longitude), z), diameter_m);
  }
}

template <typename Visit>
void SizeCells::visit_row(const Cells& cells, int row, int first, int last, const StopToken& stop, const Visit& visit) {
  constexpr int kCellsPerCheck = 64;  // cells per check of the clock, which takes a tenth of a cell's time
  const int columns = cells.columns(row), count = std::min(last - first + 1, columns);
  for (int i = 0; i < count; ++i) {
    if (i % kCellsPerCheck == 0) stop.check();
    visit(((first + i) % columns + columns) % columns);
  }
}

template <typename Visit>
void SizeCells::cells_near(int octave, const Vec3& direction, double angle, const StopToken& stop,
                           const Visit& visit) const {
  using std::numbers::pi;
  const Cells cells = cells_of(octave);
  if (!(cells.per_m2 > 0)) return;
  const double latitude = std::asin(std::clamp(direction.z(), -1.0, 1.0)),
               longitude = std::atan2(direction.y(), direction.x());
  for (int row = cells.row_at(latitude - angle); row <= cells.row_at(latitude + angle); ++row) {
    const int columns = cells.columns(row);
    // Bound half the cap's range of longitudes from above: pi, all longitudes, if the cap contains a pole.
    //
    //      .-+-.     The cap touches the meridians at longitude +- half:
    //     /  |  \    sin(half) = sin(angle) / cos(latitude), by the right-angled triangle of the pole,
    //    (   o   )   the cap's centre o and the point of contact
    //     \  |  /
    const double farthest_lat = std::abs(latitude) + angle;
    const double half = farthest_lat >= pi / 2 ? pi : std::asin(std::min(1.0, std::sin(angle) / std::cos(latitude)));
    const double middle = (longitude + pi) / (2 * pi) * columns, reach = half / (2 * pi) * columns;
    const auto first = static_cast<int>(std::floor(middle - reach)),
               last = static_cast<int>(std::floor(middle + reach));
    visit_row(cells, row, first, last, stop, [&](int column) { visit(Cell{octave, row, column}); });
  }
}

template <typename Make>
void SizeCells::in_box(int octave, const Footprint& box, const StopToken& stop, const Make& make) const {
  const Cells cells = cells_of(octave);
  if (!(cells.per_m2 > 0)) return;
  for (int row = cells.row_at(box.south_deg * kRadiansPerDegree);
       row <= cells.row_at(box.north_deg * kRadiansPerDegree); ++row) {
    const int columns = cells.columns(row);
    const auto column_at = [&](double lon_deg) {
      return static_cast<int>(std::floor((lon_deg + 180) / 360 * columns));
    };
    visit_row(cells, row, column_at(box.west_deg), column_at(box.east_deg), stop,
              [&](int column) { draw(cells, row, column, make); });
  }
}

}  // namespace selenograph::dem
