// A population of rocks that is a function of place, seed and law alone (size_cells.h), denser around fresh craters.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "dem/detail/crater_field.h"
#include "dem/detail/size_cells.h"

namespace selenograph::dem {

// Counted between craters in the area of VIPER's mission, and in the rocky parts of Haworth.
SizeFrequency rocks_of_viper();
SizeFrequency rocks_of_haworth();

struct RockLaw {
  std::uint64_t seed = 0;
  SizeFrequency frequency;               // between craters
  double largest_m = 1, smallest_m = 1;  // diameters; equal: there are none
  // At the rim of a crater that has just formed there are so many times as many, and within it; outward that falls with
  // the cube of the distance, as ejecta's thickness does (McGetchin et al. 1973). 1: no more than elsewhere.
  double on_ejecta = 5;
  // Of the rocks of a crater half are left after this: 40 to 80 Ma (Basilevsky et al. 2013).
  double half_life_Ma = 60;
  // Smaller craters don't reach through the regolith, and dig out none.
  double smallest_crater_m = 30;
};

struct Rock {
  Vec3 centre;  // unit, MOON_ME
  double diameter_m;
  double age_Ma;  // of the crater that it is of; else a time that rocks have survived
  std::uint64_t id;
  std::uint64_t form;  // hashed: which of the shapes, and how it is turned
};

// Around which there are more.
struct FreshCrater {
  Vec3 centre;  // unit, MOON_ME
  double radius_m, age_Ma;
};

// Const means safe to call concurrently.
class RockField {
 public:
  explicit RockField(const RockLaw& law, const Region& of_centres = {});

  bool empty() const { return law_.smallest_m >= law_.largest_m || law_.frequency.laws.empty(); }
  int smallest_octave() const { return cells_.smallest_octave(); }
  int largest_octave() const { return cells_.largest_octave(); }
  double largest_m(int octave) const { return cells_.largest_m(octave); }
  const RockLaw& law() const { return law_; }

  // What makes places denser that are no farther than this from a direction's. `past_largest_crater`: the ground shows
  // craters of smaller octaves (Detail).
  std::vector<FreshCrater> fresh(const CraterField& craters, int past_largest_crater, const Vec3& direction,
                                 double radius_m, const StopToken& stop = {}) const;
  // Rocks of an octave of diameters whose centre lies in a box, whose borders belong to it: appended. `fresh`: of all
  // of the box.
  void within(int octave, const Footprint& box, std::span<const FreshCrater> fresh, std::vector<Rock>& out,
              const StopToken& stop = {}) const;

  // Of a place at a distance from the centre of a crater, over its radius: how far it is from 1 times as many rocks, 0,
  // to on_ejecta times as many, 1.
  double enriched(double age_Ma, double radii) const;

 private:
  RockLaw law_;
  Region region_;
  SizeCells cells_;
};

}  // namespace selenograph::dem
