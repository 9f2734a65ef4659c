// Fragments: the rocks of a law that are too small to be bodies of their own. They are part of the heights, so that
// frames from a few metres show them at the cost of ground.
//
//          ___
//      __/    \       A fragment is a convex body of planes around an ellipsoid, partly buried: 0.18 to 0.5 of its size
//   __/ |      \__    is above the ground, its second horizontal axis is 0.62 to 0.9 of its size. Of overlapping ones
//                     of an octave the highest counts: this bounds the octave's height.
//
// Fragments of Apollo and Luna samples are equant: their axes are as 1 : 0.76 : 0.58. Their sizes follow the power law
// of the rocks between craters; Surveyors counted 28 to 91 per m^2 above 1 cm, VIPER's law has 28. Ejecta of craters
// have no more of them.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "dem/detail/direction_grid.h"
#include "dem/detail/region.h"
#include "dem/detail/rock_field.h"

namespace selenograph::dem {

// Thread-safe: const functions may be called concurrently.
class FragmentField {
 public:
  // Fragments have diameters from smallest_fragment_m to smallest_m of the law.
  explicit FragmentField(const RockLaw& law, const Region& region_of_centres = {});

  bool empty() const { return smallest_octave() > largest_octave(); }
  // Octaves [2^k, 2^(k+1)) m of diameters; smallest above largest: no fragments.
  int smallest_octave() const { return cells_.smallest_octave(); }
  int largest_octave() const { return cells_.largest_octave(); }
  // Mean height of an octave of fragments, and a bound on their height, m.
  double mean_m(int octave) const { return means_[index(octave)].height_m; }
  double max_height_m(int octave) const;
  // Receives the cover and the brightness of fragments, by position. A span may be empty.
  struct Marks {
    std::span<float> on_fragment;  // set to 1 where a fragment shows
    std::span<double> factor;      // of the albedo: what fragments are brighter than soil is added, less its mean
  };
  // Adds one octave of fragments to the heights at a grid's positions, row by row, and subtracts `shares` (empty: 1
  // everywhere) times its mean height.
  void add(const DirectionGrid& grid, int octave, std::span<const double> shares, std::span<double> heights_m,
           const Marks& marks, const StopToken& stop) const;
  // Returns the area of the circles of an octave's fragments whose centres are in a box, m^2.
  double area_m2(int octave, const Footprint& box, const StopToken& stop = {}) const;

 private:
  struct Means {
    double height_m = 0, brighter = 0;
  };
  Means measure(int octave) const;
  std::size_t index(int octave) const { return static_cast<std::size_t>(octave - smallest_octave()); }

  RockLaw law_;
  Region region_;
  SizeCells cells_;
  std::vector<Means> means_;  // by octave, from the smallest
};

}  // namespace selenograph::dem
