// Packets whose directions have components at, next to and away from zero. Embree's bundled packets lose such rays;
// random directions don't find that out, cameras that look along an axis do.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "engine/scene/selection.h"
#include "engine/visibility/points/trace.h"
#include "tests/support/effort.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::engine {
namespace {

// All blocks of a level within an angle of a direction.
Selection around(const Vec3& up, int level, double angle_rad) {
  Selection selection;
  for (int row = 0; row < dem::rows_of(level); ++row)
    for (int col = 0; col < dem::columns_of(level, row); ++col) {
      const dem::BlockExtent e = dem::extent_of({level, row, col});
      bool near = false;
      for (const int j : {0, 1, 2})
        for (const int i : {0, 1, 2})
          near |= to_cartesian({dem::lat_deg_of(e.lat0 + e.quads / 2 * j * e.lat_step),
                                dem::lon_deg_of(e.lon0 + e.quads / 2 * i * e.lon_step), 0})
                      .normalized()
                      .dot(up) > std::cos(angle_rad);
      if (near) selection.blocks.push_back({level, row, col});
    }
  return selection;
}

// Zero, or of any size down to 1e-16 and at most `largest`, of either sign.
double any_size(std::mt19937_64& random, double largest) {
  std::uniform_real_distribution<double> unit(0, 1);
  if (unit(random) < 0.3) return 0;
  return (unit(random) < 0.5 ? -1 : 1) * largest * std::pow(10, -14 * unit(random));
}

TEST(Packets, AxisAlignedRaysAreNotLost) {
  const test::TemporaryFolder folder;
  test::write_global_tile(folder.path(), 4, [](double lat_deg, double lon_deg) {
    return 1500 * std::sin(lat_deg) * std::cos(2 * lon_deg) * std::cos(lat_deg * 0.0174);
  });
  const dem::PyramidTerrain terrain(dem::Catalogue(std::vector<std::string>{folder.path()}), {});
  std::mt19937_64 random(1);
  for (int axis = 0; axis < 6; ++axis) {
    Vec3 up = Vec3::zero();
    up[axis / 2] = axis % 2 ? -1 : 1;
    const Scene scene(terrain, {around(up, 4, 0.15).blocks, up * kMoonRadius_m}, 2);
    int lost = 0;
    for (int p = 0; p < test::cases(20000); ++p) {
      Rays rays;
      const double together = std::pow(10, -16.0 * (p % 17) / 16);
      for (int i = 0; i < kPacket; ++i) {
        Vec3 aside, tilt;
        for (int k = 0; k < 3; ++k)
          aside[k] = any_size(random, 0.015) * (i % 2 ? 1 : together), tilt[k] = any_size(random, 0.01);
        const Vec3 origin = (up + aside).normalized() * (kMoonRadius_m + 20000);
        rays.set(i, origin, p % 3 == 0 ? Vec3(-origin) : p % 3 == 1 ? Vec3(-up) : Vec3(tilt - up));
      }
      SurfacePoints points;
      trace(scene, rays, points);
      for (const bool hit : points.hit) lost += !hit;
    }
    EXPECT_EQ(lost, 0) << "looking along axis " << axis;
  }
}

}  // namespace
}  // namespace selenograph::engine
