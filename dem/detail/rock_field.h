// A population of rocks as a function of place, seed and law only (size_cells.h), denser around fresh craters.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "dem/detail/crater_field.h"
#include "dem/detail/size_cells.h"

namespace selenograph::dem {

// Size-frequency law counted between craters in the area of VIPER's mission, and in the rocky parts of Haworth.
SizeFrequency rocks_of_viper();
SizeFrequency rocks_of_haworth();

struct RockLaw {
  std::uint64_t seed = 0;
  SizeFrequency frequency;               // between craters
  double largest_m = 1, smallest_m = 1;  // diameters; equal: no rocks
  // Factor of rock density within and at the rim of a newly formed crater. Outward it falls with the cube of the
  // distance, like the thickness of ejecta (McGetchin et al. 1973). 1: no enrichment.
  double on_ejecta = 5;
  // Time after which half of a crater's rocks are left: 40 to 80 Ma (Basilevsky et al. 2013).
  double half_life_Ma = 60;
  // Smaller craters do not penetrate the regolith and excavate no rocks.
  double smallest_crater_m = 30;
};

struct Rock {
  Vec3 centre;  // unit, MOON_ME
  double diameter_m;
  double age_Ma;  // age of its crater, or a survival time of rocks
  std::uint64_t id;
  std::uint64_t form;  // hash that selects shape and orientation
};

// A crater with enriched rocks around it.
struct FreshCrater {
  Vec3 centre;  // unit, MOON_ME
  double radius_m, age_Ma;
};

// Thread-safe: const functions may be called concurrently.
class RockField {
 public:
  explicit RockField(const RockLaw& law, const Region& of_centres = {});

  bool empty() const { return law_.smallest_m >= law_.largest_m || law_.frequency.laws.empty(); }
  int smallest_octave() const { return cells_.smallest_octave(); }
  int largest_octave() const { return cells_.largest_octave(); }
  double largest_m(int octave) const { return cells_.largest_m(octave); }
  const RockLaw& law() const { return law_; }

  // Craters that enrich rocks within a distance of a direction. `past_largest_crater`: the ground shows craters of
  // smaller octaves (Detail).
  std::vector<FreshCrater> fresh(const CraterField& craters, int past_largest_crater, const Vec3& direction,
                                 double radius_m, const StopToken& stop = {}) const;
  // Appends the rocks of an octave of diameters whose centre is in a box (borders included). `fresh`: the fresh craters
  // for the whole box.
  void within(int octave, const Footprint& box, std::span<const FreshCrater> fresh, std::vector<Rock>& out,
              const StopToken& stop = {}) const;

  // Enrichment at a distance from a crater's centre, in radii: 0 for none, 1 for the full factor on_ejecta.
  double enriched(double age_Ma, double radii) const;

 private:
  RockLaw law_;
  Region region_;
  SizeCells cells_;
};

}  // namespace selenograph::dem
