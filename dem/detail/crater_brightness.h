// Brightness of young craters: a factor on the albedo of the ground. With a high Sun little else is seen.
//
//   factor
//   1.7 |   ____                     bright as far as 1.25 radii; the floor is dimmer
//       | _/    \_                   farther out it falls as r^-2.4 and breaks into rays
//     1 +---------\--.-----------    a dimmer zone around 3 radii, which fades first; nothing from the reach on
//       +----+----+----+----+-- r, crater radii
//       0    1    2    3    4
//
// - Zones around new craters, brighter and then dimmer than the ground: Speyerer et al. (2019).
// - A crater is as bright as the soil that it digs up, at a tenth of its diameter: soil is mature down to some tens of
//   centimetres, immature below a metre (Robinson et al. 2015, LROC).
// - Rays of 1 km craters last 750 Ma, those of small ones fade faster (Werner & Medvedev 2010). With 6 Ma at 10 m,
//   craters of all sizes are bright for 3 to 6 % of their lives.
// - Steep walls are brighter, as soil creeps off them and bares fresh soil: by up to 0.3 where a crater's steepest
//   slope is 30 degrees, by nothing below 18. They stay so for as long as they are steep.
// - The factor at the rim, its scatter, the exponent, the rays and the walls' factor are chosen to look like images
//   from orbit.
//
// The mean of the factor over ground is 1, so that an albedo map stays true: what all craters of an octave add on
// average is subtracted. It is exact, as craters are strewn independently and what they add is summed.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/detail/crater_field.h"
#include "dem/detail/direction_grid.h"

namespace selenograph::dem {

// Thread-safe: const functions may be called concurrently.
class CraterBrightness {
 public:
  // `variation`: factor of all differences from 1; 0: no crater is bright.
  CraterBrightness(const CraterField& craters, double variation);

  bool none() const { return variation_ == 0; }
  // Returns what a crater adds at its rim, averaged over azimuths: 0 for all but young craters.
  double at_rim(const Crater& crater) const;
  // Mean of what an octave of craters adds; add() subtracts it.
  double mean(int octave) const { return means_[static_cast<std::size_t>(octave - smallest_octave_)]; }
  // Adds to `factor`, row by row, `weight` times what the craters of an octave add at a grid's positions, less `shares`
  // (empty: 1 everywhere) times its mean. `craters`: the field, perhaps of a region, with the law given to the
  // constructor.
  void add(const CraterField& craters, const DirectionGrid& grid, int octave, std::span<const double> shares,
           std::span<double> factor, const StopToken& stop, double weight = 1) const;

 private:
  // A crater adds `bright` next to its rim, less `dim` in the dimmer zone, out to one of the reaches, and `wall` on its
  // wall.
  struct Zones {
    double bright = 0, dim = 0, wall = 0;
    int reach = 0;  // index of a Profile; valid unless none()
    bool none() const { return bright == 0 && wall == 0; }
    double reach_radii() const;
  };
  Zones zones_of(double diameter_m, double age_Ma, double local_factor) const;
  // Returns what a wall adds. `scale_over_diameter`, `age`: as of a Crater.
  double wall_of(double scale_over_diameter, double age) const;
  // Averages wall_of() over the craters of a diameter.
  double mean_wall(const CraterAges& ages, double diameter_m) const;
  Zones zones_of(const Crater& crater) const;
  class Rays;
  class RaysCache;
  static void add_crater(const Crater& crater, const Zones& zones, const DirectionGrid& grid, RaysCache& cache,
                         std::span<float> added);
  double mean_of_sizes(const CraterAges& ages, double smallest_m, double largest_m) const;

  double variation_;
  int smallest_octave_;
  std::vector<double> means_;  // by octave, from the smallest
};

}  // namespace selenograph::dem
