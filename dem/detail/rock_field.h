// A population of rocks as a function of place, seed and law only (size_cells.h), denser around fresh craters.
//
// Rocks between craters and those of ejecta are two populations, each drawn by itself: where no fresh crater is near,
// the second takes no time.
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
  // distance, like the thickness of ejecta (McGetchin et al. 1973). 1: no enrichment. Rocks cover 0.4 % of the Moon
  // (Bandfield et al. 2011) and, of the rockiest ejecta, 0.27 (age / Ma)^-0.46 (Ghent et al. 2014): 23 times as much
  // after 10 Ma and 8 times after 100 Ma, where 25 and the half life below give 22 and 8.6 times.
  double on_ejecta = 25;
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
  // How it has settled (RockField::settle).
  double worn = 0;      // share of such rocks that are destroyed by its age: 0 for a new one, towards 1
  double height_m = 0;  // of its top above the ground
  double buried = 0;    // share of its own height that is below the ground
  double fillet_m = 0;  // height of the soil banked against its sides
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

  // Sets `worn` and what follows from it and from the rock's form. Whole rocks are 0.6 to 1 diameters high. A new one
  // is buried by 5 to 35 % of that, as it landed; up to 40 % are added with age, most for some rocks, a little for
  // others. Above the ground are 0.64 diameters of new rocks, 0.55 of those between craters (0.6 on average, Demidov &
  // Basilevsky 2014). Soil is banked against old ones, up to 18 to 30 % of their height above ground and a tenth of
  // their diameter, which is the angle of repose: fillets grow by abrasion of the rock and by ejecta, as the square
  // root of time to begin with, like all that spreads by diffusion (Ruesch et al. 2024 and Apollo's preliminary
  // science reports describe the processes; the numbers are ours).
  void settle(Rock& rock) const;

  // Enrichment at a distance from a crater's centre, in radii: 0 for none, 1 for the full factor on_ejecta.
  double enriched(double age_Ma, double radii) const;

 private:
  RockLaw law_;
  Region region_;
  SizeCells cells_, ejecta_;  // between craters; what fresh craters add at most
};

}  // namespace selenograph::dem
