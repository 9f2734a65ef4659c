// Terrain below the posts: what craters and relief add to heights, level by level.
//
// A level shows an octave of craters when its posts are at most a quarter of the octave's smallest diameter apart, and
// an octave of relief when they are at most a quarter of its wavelength apart. What a level shows it has exactly: the
// height at a vertex is a function of the place, of the preset and of the level.
//
// Craters of one octave don't add up: of cavities the deepest counts, of rims the highest. So an octave's part lies
// between bounds, whatever the population, and the bound of what a level leaves out follows.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "dem/detail/crater_field.h"
#include "dem/detail/relief.h"

namespace selenograph::dem {

struct DetailPreset {
  std::uint64_t fingerprint = 0;  // of what it was read from
  CraterLaw craters;
  ReliefLaw relief;
};

// Rows of equal latitude and columns of equal longitude, both ascending: sines and cosines.
struct DirectionGrid {
  std::span<const double> sin_lat, cos_lat, sin_lon, cos_lon;
  std::size_t rows() const { return sin_lat.size(); }
  std::size_t columns() const { return sin_lon.size(); }
};

// Const means safe to call concurrently.
class Detail {
 public:
  explicit Detail(const DetailPreset& preset);

  const DetailPreset& preset() const { return preset_; }
  // The first level that shows everything.
  int finest_level() const;
  // The smallest octave of craters, and of relief, that a level shows.
  static int smallest_octave(int level);

  // To heights in metres, row by row: what a level shows that the posts' level doesn't. The same at a place from any
  // grid, to the bit.
  void add(const DirectionGrid& grid, int level, int posts_level, std::span<double> heights_m) const;

  // What all finer levels add to a level's heights lies between -this and this.
  double left_out_m(int level, int posts_level) const;

  // Where the mean of an octave of craters would be, were it not subtracted: so that detail moves no ground as a whole.
  double mean_m(int octave) const;

  const CraterField& craters() const { return craters_; }
  const Relief& relief() const { return relief_; }

 private:
  void add_craters(const DirectionGrid& grid, int octave, std::span<double> heights_m) const;

  DetailPreset preset_;
  CraterField craters_;
  Relief relief_;
  std::vector<double> means_m_;  // by octave, from the smallest
};

}  // namespace selenograph::dem
