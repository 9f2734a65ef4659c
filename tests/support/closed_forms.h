// Ground whose light from terrain has a closed form: one reflection by Lambert's law, without the Moon's curvature.
//
//   bowl: a part of a sphere              trench: two plane walls, endless to north and south
//   -----.              .-----            -----.              .-----
//         `-.        .-'                        `-.        .-'
//            `-.__.-'                              `-.  .-'
//   |<------ width ----->|                            \/
//   The light is the same everywhere.     Each wall sees the other one as a strip.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "dem/grid/geodesy.h"

namespace selenograph::test {

// Lengths are in widths. A point is `east` and `north` of the centre.
struct ClosedForm {
  std::string name;              // "bowl-5", with diameter over depth; "trench-25", with the walls' slope in degrees
  std::vector<double> suns_deg;  // elevations at which all of the closed form holds
  double sun_azimuth_deg;
  double half_north;                          // half the extent from south to north; from west to east it is kHalfEast
  std::function<double(double east)> height;  // by the distance from the axis or, of a bowl, from the centre
  bool is_round;                              // a bowl
  // Returns the light at a point as a share of sunlight at normal incidence, by the Sun's elevation and the albedo; NaN
  // next to edges, which posts round off.
  std::function<double(double east, double north, double sun_elevation_deg, double albedo)> light;

  static constexpr double kHalfEast = 0.6;
};

// Returns bowls of 5, 8 and 14 depths (Ingersoll, Svitek & Murray, Icarus 100, 40, 1992), and trenches of 15, 25 and 45
// degrees.
std::vector<ClosedForm> bowls();
std::vector<ClosedForm> trenches();

// The centre and the post spacing of the grounds that write_ground() makes. The spacing is that of a level of the
// terrain's blocks, 1.85 m, so that no post is interpolated.
inline constexpr Geographic kClosedFormCenter{0, 40, 0};
inline constexpr double kClosedFormPostsPerDegree = 16384;
inline constexpr double kClosedFormPosts_m = kMoonRadius_m * kRadiansPerDegree / kClosedFormPostsPerDegree;

// Writes the ground, `width_posts` posts wide, as a GeoTIFF. Throws as dem::write_geotiff().
void write_ground(const ClosedForm& form, int width_posts, const std::string& path);

// Returns the light at a position on that ground, W m-2.
double light_w_m2(const ClosedForm& form, int width_posts, const Vec3& position_m, double sun_elevation_deg,
                  double albedo);

}  // namespace selenograph::test
