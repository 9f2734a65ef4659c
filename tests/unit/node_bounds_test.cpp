// A block's bounds hold all of its terrain; the horizon's dip in closed form.
#include "engine/scene/node_bounds.h"

#include <gtest/gtest.h>

#include <cmath>

namespace selenograph::engine {
namespace {

dem::BlockId block_around(int level, double lat, double lon) {
  return dem::block_at(level, static_cast<dem::Tick>(std::lround((lat + 90) * dem::kTicksPerDegree)),
                       dem::wrap_lon(std::llround((lon + 180) * dem::kTicksPerDegree)));
}

TEST(NodeBoundsTest, BoundingSphereContainsTheFootprint) {
  for (const double lat : {0.3, 60.1, 88.9}) {
    const dem::BlockId id = block_around(5, lat, 23);
    const dem::BlockExtent e = dem::extent_of(id);
    const NodeBounds bounds = bounds_of(id, -2000, 5000);
    for (int r = 0; r <= 8; ++r)
      for (int c = 0; c <= 8; ++c)
        for (const double height_m : {-2000.0, 1000.0, 5000.0}) {
          const double lat_deg = (e.lat0 + r * (e.lat1() - e.lat0) / 8.0) / dem::kTicksPerDegree - 90,
                       lon_deg =
                           (e.lon0 + c * (static_cast<double>(e.lon_step) * e.quads) / 8.0) / dem::kTicksPerDegree -
                           180;
          const Vec3 place = to_cartesian({lat_deg, lon_deg, height_m});
          EXPECT_LE((place - bounds.centre).norm(), bounds.radius_m + 1e-6) << lat_deg << " " << lon_deg;
        }
  }
}

TEST(NodeBoundsTest, NonTerrainReceiverIsItsBoundingSphere) {
  const Vec3 centre(1.8e6, 2e5, -3e4);
  const NodeBounds bounds = bounds_around(centre, 300);
  EXPECT_EQ(bounds.centre, centre);
  EXPECT_EQ(bounds.radius_m, 300);
  EXPECT_EQ(bounds.bulge_m, 300);
  for (const Vec3& p : bounds.points) EXPECT_EQ(p, centre);
}

// From h above a sphere of radius R its horizon is acos(R / (R + h)) away, as seen from the centre.
TEST(NodeBoundsTest, BelowTheHorizonIsWhatTheSphereHides) {
  const Vec3 from = to_cartesian({0, 0, 100e3});
  // 19 degrees for the datum sphere, and 5 more at most until a point on it is below that of the inside, kilometres
  // deeper.
  const auto ball_at = [](double lon_deg) { return bounds_around(to_cartesian({0, lon_deg, 0}), 10); };
  EXPECT_FALSE(below_horizon(from, ball_at(0)));
  EXPECT_FALSE(below_horizon(from, ball_at(18.9)));
  EXPECT_TRUE(below_horizon(from, ball_at(35)));
  EXPECT_TRUE(below_horizon(from, ball_at(180)));
  EXPECT_FALSE(below_horizon(from, bounds_around(to_cartesian({0, 35, 0}), 400e3))) << "a large ball looks over it";
}

}  // namespace
}  // namespace selenograph::engine
