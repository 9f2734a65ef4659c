// A population of rocks as a function of position, seed and law only (size_cells.h), denser around fresh craters.
//
// Rocks between craters and rocks of ejecta are two populations, each drawn by itself. Far from fresh craters the
// second is not drawn at all. The second is drawn at its largest density and thinned by the enrichment at each rock:
//
//   enrichment  1 ___              1 inside a new crater's rim, then falling with the cube of the distance from the
//                    \             centre, halved every half_life_Ma, cut off at 8 radii
//                     `-._____
//             rim: r = 1      8
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "dem/detail/crater_field.h"
#include "dem/detail/size_cells.h"

namespace selenograph::dem {

// Return the size-frequency laws counted between craters in the area of VIPER's mission, and in the rocky parts of
// Haworth.
SizeFrequency rocks_of_viper();
SizeFrequency rocks_of_haworth();

struct RockLaw {
  std::uint64_t seed = 0;
  SizeFrequency frequency;               // between craters
  double largest_m = 1, smallest_m = 1;  // diameters; equal: no rocks
  // Rocks from this diameter to smallest_m are part of the heights (fragment_field.h); 0: none.
  double smallest_fragment_m = 0;
  // Factor of rock density within and at the rim of a newly formed crater. Outward it falls with the cube of the
  // distance, like the thickness of ejecta (McGetchin et al. 1973). 1: no enrichment. Rocks cover 0.4 % of the Moon
  // (Bandfield et al. 2011) and, of the rockiest ejecta, 0.27 (age / Ma)^-0.46 (Ghent et al. 2014): 23 times as much
  // after 10 Ma and 8 times after 100 Ma, where 25 and the half life below give 22 and 8.6 times.
  double on_ejecta = 25;
  // Time after which half of a crater's rocks remain: 40 to 80 Ma (Basilevsky et al. 2013).
  double half_life_Ma = 60;
  // Smaller craters do not penetrate the regolith and excavate no rocks.
  double smallest_crater_m = 30;
  double albedo_variation = 0;  // factor of kBrighter and its scatter; 0: rocks are as bright as the ground
};

// Rocks are brighter than mature soil by this share of its albedo, with this standard deviation. Both are chosen to
// look like images from landers.
inline constexpr double kBrighter = 0.19, kBrighterScatter = 0.16;

struct Rock {
  Vec3 centre;  // unit, MOON_ME
  double diameter_m;
  double age_Ma;  // age of the crater that ejected it; between craters, drawn from the rocks' survival times
  std::uint64_t id;
  std::uint64_t form;  // hash that selects shape and orientation
  // State set by RockField::settle.
  double worn = 0;        // share of rocks destroyed by its age: 0 for a new one, towards 1 for old ones
  double height_m = 0;    // height of its top above the ground
  double buried = 0;      // share of its own height that is below the ground
  double fillet_m = 0;    // height of the soil banked against its sides
  double brightness = 1;  // factor of the ground's constant albedo
};

// A crater with enriched rocks around it.
struct FreshCrater {
  Vec3 centre;  // unit, MOON_ME
  double radius_m, age_Ma;
};

// Thread-safe: const functions may be called concurrently.
class RockField {
 public:
  explicit RockField(const RockLaw& law, const Region& region_of_centres = {});

  bool empty() const { return law_.smallest_m >= law_.largest_m || law_.frequency.laws.empty(); }
  int smallest_octave() const { return cells_.smallest_octave(); }
  int largest_octave() const { return cells_.largest_octave(); }
  double largest_m(int octave) const { return cells_.largest_m(octave); }
  const RockLaw& law() const { return law_; }

  // Returns the craters that enrich rocks within a distance of a direction. `past_largest_crater`: the octave past the
  // largest that the ground shows (Detail::past_largest_octave).
  std::vector<FreshCrater> fresh(const CraterField& craters, int past_largest_crater, const Vec3& direction,
                                 double radius_m, const StopToken& stop = {}) const;
  // Appends the rocks of an octave of diameters whose centre is in a box (borders included). `fresh`: the fresh craters
  // of the box.
  void in_box(int octave, const Footprint& box, std::span<const FreshCrater> fresh, std::vector<Rock>& out,
              const StopToken& stop = {}) const;

  // Sets a rock's state from its age and its form.
  //
  //        ____      height_m above the ground     Rocks are 0.6 to 1 diameters high. A new one is buried by 5 to 35 %
  //      /      \                                  of that on landing; age adds up to 40 %, drawn for each rock. Above
  //    /|        |\  fillet_m of banked soil       the ground are 0.64 diameters of new rocks and 0.55 of rocks between
  //  ___|        |___ ground                       craters (0.6 on average, Demidov & Basilevsky 2014).
  //      \______/    buried share of the height
  //
  // A fillet reaches at most 18 to 30 % of the height above ground and a tenth of the diameter, the angle of repose. It
  // grows by abrasion of the rock and by ejecta, first as the square root of time, as in diffusion. Ruesch et al.
  // (2024) and Apollo's preliminary science reports describe the processes; the numbers are assumed.
  void settle(Rock& rock) const;

  // Returns the enrichment at a distance from a crater's centre, in radii: 0 for none, 1 for the full factor on_ejecta.
  double enriched(double age_Ma, double radii) const;

 private:
  RockLaw law_;
  Region region_;
  SizeCells cells_;   // rocks between craters
  SizeCells ejecta_;  // the largest number of rocks that fresh craters add anywhere
};

}  // namespace selenograph::dem
