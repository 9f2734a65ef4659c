// A population whose sizes follow a law, drawn by place: craters, rocks. Nothing is drawn in an order, so that any
// block, tile, thread and process finds the same ones.
//
// Members are grouped by octaves of diameter, [2^k, 2^(k+1)) m, and each octave's are drawn in cells of its own: rings
// of latitude, cut into pieces of nearly equal width. A cell's number of members is Poisson, of its area times the
// law's density.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <tuple>
#include <vector>

#include "dem/files/raster_info.h"
#include "dem/grid/geodesy.h"
#include "dem/support/stop_token.h"

namespace selenograph::dem {

// Number above a diameter, per m^2: the smallest of some power laws, each `per_m2 (D / 1 m)^-exponent`.
struct SizeFrequency {
  struct Power {
    double per_m2 = 0, exponent = 0;
  };
  std::vector<Power> laws;
  double above(double diameter_m) const;
  // 0 unless the first is the smaller one.
  double between(double smallest_m, double largest_m) const {
    return smallest_m < largest_m ? above(smallest_m) - above(largest_m) : 0;
  }
};

// Of what is found (its member() has a diameter and an id), by diameter, the largest first; the same ones once.
template <typename Feature>
std::vector<Feature> largest_first(std::vector<Feature> found) {
  const auto key = [](const Feature& f) { return std::tuple(-f.member().diameter_m, f.member().id); };
  std::sort(found.begin(), found.end(), [&](const Feature& a, const Feature& b) { return key(a) < key(b); });
  const auto same = [&](const Feature& a, const Feature& b) { return key(a) == key(b); };
  found.erase(std::unique(found.begin(), found.end(), same), found.end());
  return found;
}

// The octave of a diameter.
inline int octave_of(double diameter_m) { return static_cast<int>(std::floor(std::log2(diameter_m))); }

// Numbers of a cell, one after the other.
class Draws {
 public:
  Draws(std::uint64_t seed, int octave, int row, int column) : key_{seed, octave, row, column, 0} {}
  std::uint64_t bits();
  // In (0, 1).
  double uniform() { return (static_cast<double>(bits() >> 11) + 0.5) * 0x1p-53; }
  // Two of these are a standard normal (Box & Muller 1958).
  double normal();
  // By the inverse of its distribution function.
  int poisson(double mean);

 private:
  struct Key {
    std::uint64_t seed;
    std::int32_t octave, row, column;
    std::uint32_t index;
  } key_;
  static_assert(sizeof(Key) == 24);  // no padding: all of it is hashed
};

// Const means safe to call concurrently.
class SizeCells {
 public:
  // A cell's side over the octave's smallest diameter.
  static constexpr double kCellDiameters = 8;

  // Equal diameters: there are none. Densities are the law's times `times`.
  SizeCells(std::uint64_t seed, SizeFrequency frequency, double smallest_m, double largest_m, double times = 1);

  // The octaves that have any: diameters from 2^k to 2^(k+1) m, cut to the limits.
  int smallest_octave() const { return smallest_octave_; }
  int largest_octave() const { return largest_octave_; }
  double largest_m(int octave) const { return std::min(largest_m_, std::ldexp(2.0, octave)); }

  // make(draws, centre, diameter_m) of each member of an octave in the cells that an angle around a direction touches,
  // or a box: those of some places beyond, too. The centre is on the unit sphere. `east_deg` may exceed 180.
  template <typename Make>
  void near(int octave, const Vec3& direction, double angle_rad, const StopToken& stop, const Make& make) const;
  template <typename Make>
  void in_box(int octave, const Footprint& box, const StopToken& stop, const Make& make) const;

 private:
  struct Cells {
    int octave = 0, rows = 0;
    double smallest_m = 0, largest_m = 0;  // of the octave, within the limits
    double per_m2 = 0;
    double exponent = 0;  // of the power law between the two

    double south(int row) const { return (static_cast<double>(row) / rows - 0.5) * std::numbers::pi; }
    int columns(int row) const;
    int row_at(double latitude) const;
    double diameter_m(double uniform) const;
    double expected(int row) const;  // in each cell of a row
  };
  Cells cells_of(int octave) const;
  template <typename Make>
  void draw(const Cells& cells, int row, int column, const Make& make) const;
  // Columns count on around the Moon; each cell is drawn once.
  template <typename Make>
  void draw_row(const Cells& cells, int row, int first, int last, const StopToken& stop, const Make& make) const;

  std::uint64_t seed_;
  SizeFrequency frequency_;
  double smallest_m_, largest_m_, times_;
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
    const double around = std::sqrt(std::max(0.0, 1 - z * z));
    const double diameter_m = cells.diameter_m(draws.uniform());
    make(draws, Vec3(around * std::cos(longitude), around * std::sin(longitude), z), diameter_m);
  }
}

template <typename Make>
void SizeCells::draw_row(const Cells& cells, int row, int first, int last, const StopToken& stop,
                         const Make& make) const {
  constexpr int kCellsPerLook = 64;  // at the clock, which takes a tenth of a cell's time
  const int columns = cells.columns(row), most = std::min(last - first + 1, columns);
  for (int i = 0; i < most; ++i) {
    if (i % kCellsPerLook == 0) stop.check();
    draw(cells, row, ((first + i) % columns + columns) % columns, make);
  }
}

template <typename Make>
void SizeCells::near(int octave, const Vec3& direction, double angle, const StopToken& stop, const Make& make) const {
  using std::numbers::pi;
  const Cells cells = cells_of(octave);
  if (!(cells.per_m2 > 0)) return;
  const double latitude = std::asin(std::clamp(direction.z(), -1.0, 1.0)),
               longitude = std::atan2(direction.y(), direction.x());
  for (int row = cells.row_at(latitude - angle); row <= cells.row_at(latitude + angle); ++row) {
    const int columns = cells.columns(row);
    // Half of the longitudes that a cap covers at most: everything where it holds a pole.
    const double away = std::abs(latitude) + angle;
    const double half = away >= pi / 2 ? pi : std::asin(std::min(1.0, std::sin(angle) / std::cos(latitude)));
    const double place = (longitude + pi) / (2 * pi) * columns, reach = half / (2 * pi) * columns;
    const auto first = static_cast<int>(std::floor(place - reach)), last = static_cast<int>(std::floor(place + reach));
    draw_row(cells, row, first, last, stop, make);
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
    draw_row(cells, row, column_at(box.west_deg), column_at(box.east_deg), stop, make);
  }
}

}  // namespace selenograph::dem
