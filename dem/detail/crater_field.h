// A population of craters as a function of position, seed and law only (size_cells.h).
//
//   octave k (large)      octave k - 1           A crater belongs to the cell of its centre, but reaches into others.
//   +-------+-------+     +---+---+---+---+      A query for a ball visits the cells within the ball's radius plus the
//   |   ( ) |       |     | o |   |  o|   |      octave's largest reach, draws each cell's craters, and keeps those
//   |       |   ( ) |     +---+---+---+---+      that reach the ball. Cells are 8 smallest diameters wide.
//   +-------+-------+     |   | o |   | o |
//                         +---+---+---+---+
#pragma once

#include <cstdint>
#include <optional>
#include <tuple>
#include <vector>

#include "dem/base/pool.h"
#include "dem/detail/crater_ages.h"
#include "dem/detail/crater_shape.h"
#include "dem/detail/region.h"
#include "dem/detail/size_cells.h"
#include "dem/grid/geodesy.h"

namespace selenograph::dem {

// Equilibrium (Trask 1966): cumulative 10^-1.1 D^-2 per m^2. Like all such counts it counts visible craters.
SizeFrequency equilibrium();

// A crater is visible while its depth from rim to floor is this share of its diameter or more. Shallower, older ones
// are part of the relief.
inline constexpr double kVisible = 0.03;

struct CraterLaw {
  std::uint64_t seed = 0;
  SizeFrequency frequency = equilibrium();  // law of visible craters
  double largest_m = 1, smallest_m = 1;     // diameters; equal: no craters
  // Age of the surface. Sizes that have not reached the law by then have as many craters as have formed.
  double oldest_Ma = 3500;
};

// Returns the depth from rim to floor over the diameter of fresh craters: from 10 m on the medians by size of Stopar et
// al. (2017), interpolated in the logarithm of the diameter; below 3 m a value with which craters of all ages are 0.06
// deep on average, as Chang'e-4 measured (0.061 for decimetres to metres, Wu et al. 2021).
double fresh_depth_over_diameter(double diameter_m);
inline constexpr double kDepthScatter = 0.02;  // standard deviation
// Returns the fresh depth over the diameter of a crater that differs from the median by a normal deviate, within three
// standard deviations. Every fresh crater is visible.
double fresh_ratio(double diameter_m, double normal_deviate);

struct Crater {
  Vec3 centre;  // unit, MOON_ME
  double diameter_m;
  double depth_m;  // present depth, from rim to floor
  double age_Ma;
  double age;    // kappa t / R^2 for CraterShape, scaled so that kVisible is reached at the end of the crater's life
  double scale;  // factor of the shape's height, m
  std::uint64_t id;
  CraterOutline outline{};  // a circle unless drawn by CraterField
  double reach_m() const { return CraterShape::reach(age) * diameter_m / 2; }
};

// Returns the distance from a crater's centre, in crater radii, at which a round crater is as high as this one is at a
// direction: 1 on the rim.
double round_radii(const Crater& crater, const Vec3& direction);

// The order in which craters replace the ground of their octave.
inline bool formed_before(const Crater& a, const Crater& b) {
  return std::tie(b.age_Ma, a.id) < std::tie(a.age_Ma, b.id);
}

// Thread-safe: const functions may be called concurrently.
class CraterField {
 public:
  explicit CraterField(const CraterLaw& law, const Region& region_of_centres = {});

  // Octaves that have craters: diameters from 2^k to 2^(k+1) m, limited to the law's.
  int smallest_octave() const { return cells_.smallest_octave(); }
  int largest_octave() const { return cells_.largest_octave(); }

  // Appends the craters of an octave that may reach into a ball around a direction; each once, in no particular order.
  void near(int octave, const Vec3& direction, double radius_m, std::vector<Crater>& out,
            const StopToken& stop = {}) const;
  // Appends the craters of an octave with their centres within a distance of a direction, and some beyond it; each
  // once, in no particular order.
  void within(int octave, const Vec3& direction, double distance_m, std::vector<Crater>& out,
              const StopToken& stop = {}) const;
  // Returns the craters whose centre is in a box. `east_deg` may exceed 180.
  std::vector<Crater> in_box(int octave, const Footprint& box, const StopToken& stop = {}) const;

  // Returns the expected number of craters of at least a diameter, inside the region: by the law, or as many as have
  // formed if that is fewer.
  double number_per_m2(double smallest_m) const;

  double largest_m(int octave) const { return cells_.largest_m(octave); }
  // Bounds on the heights of an octave's craters: between -deepest_m and highest_m.
  double deepest_m(int octave) const;
  double highest_m(int octave) const;

  const CraterLaw& law() const { return law_; }
  const CraterAges& ages() const { return ages_; }
  const CraterShape& shape() const { return CraterShape::of_all(); }

 private:
  // The latest cells of all fields: adjacent blocks share their large craters.
  class CellCache;
  static Pool<CellCache>& cell_caches();
  // Draws a crater's depth and age. Empty: it has not formed yet.
  std::optional<Crater> draw_crater(Draws& draws, const Vec3& centre, double diameter_m) const;

  std::uint64_t id_;  // distinguishes this population from others of the process in the caches
  CraterLaw law_;
  CraterAges ages_;
  Region region_;
  SizeCells cells_;
};

}  // namespace selenograph::dem
