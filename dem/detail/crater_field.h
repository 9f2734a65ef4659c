// A population of craters that is a function of place, seed and law alone (size_cells.h).
#pragma once

#include <cstdint>
#include <vector>

#include "dem/detail/crater_shape.h"
#include "dem/detail/region.h"
#include "dem/detail/size_cells.h"
#include "dem/grid/geodesy.h"

namespace selenograph::dem {

// Equilibrium (Trask 1966): cumulative 10^-1.1 D^-2 per m^2.
SizeFrequency equilibrium();

struct CraterLaw {
  std::uint64_t seed = 0;
  SizeFrequency frequency = equilibrium();
  double largest_m = 1, smallest_m = 1;  // diameters; equal: there are none
  // Impacts come at a constant rate: ages are uniform up to this, or to when CraterShape::kOldest is reached. That is
  // what an equilibrium is: craters vanish as fast as they are made.
  double oldest_Ma = 3500;
  double diffusivity_m2_per_Ma = kDiffusivity_m2_per_Ma;
};

// From rim to floor over the diameter, of fresh ones (Stopar et al. 2017, table of medians by size), between them by
// the logarithm of the diameter.
double fresh_depth_over_diameter(double diameter_m);
inline constexpr double kDepthScatter = 0.02;  // standard deviation

struct Crater {
  Vec3 centre;  // unit, MOON_ME
  double diameter_m;
  double depth_m;  // from rim to floor, today
  double age_Ma;
  double age;    // as CraterShape takes it
  double scale;  // m: the shape's height is to be multiplied by it
  std::uint64_t id;
  double reach_m() const { return CraterShape::reach(age) * diameter_m / 2; }
};

// Const means safe to call concurrently.
class CraterField {
 public:
  explicit CraterField(const CraterLaw& law, const Region& of_centres = {});

  // The octaves that have any: diameters from 2^k to 2^(k+1) m, cut to the law's.
  int smallest_octave() const { return cells_.smallest_octave(); }
  int largest_octave() const { return cells_.largest_octave(); }

  // Those of an octave whose reach may meet a ball around a place on the sphere; in no particular order, but each once.
  void near(int octave, const Vec3& direction, double radius_m, std::vector<Crater>& out,
            const StopToken& stop = {}) const;
  // Those whose centre lies in a box. `east_deg` may exceed 180.
  std::vector<Crater> within(int octave, const Footprint& box, const StopToken& stop = {}) const;

  double largest_m(int octave) const { return cells_.largest_m(octave); }
  // What an octave's craters add to heights lies between these.
  double deepest_m(int octave) const;
  double highest_m(int octave) const;

  const CraterLaw& law() const { return law_; }
  const CraterShape& shape() const { return shape_; }

 private:
  Crater made(Draws& draws, const Vec3& centre, double diameter_m) const;

  CraterLaw law_;
  Region region_;
  CraterShape shape_;
  SizeCells cells_;
};

}  // namespace selenograph::dem
