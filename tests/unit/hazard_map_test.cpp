// Hazard maps of ground with closed forms, where a map's scale changes and where it ends.
#include "engine/hazard/hazard_map.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

namespace selenograph::engine {
namespace {

constexpr double kStandardParallel_deg = 86;

struct HazardsFound {
  FrameProducts products;
  std::vector<std::string> warnings;
};

// Over ground whose height, m, is given by the place on the map; rocks in the given pixels.
HazardsFound found(const MapRequest& request, const std::function<double(const dem::MapPoint&)>& height_m,
                   const std::vector<Vec2i>& rocks = {}) {
  const MapRequest drawn = request_with_margin(request);
  const dem::MapTransform map(drawn.grid.plane);
  HazardsFound out;
  for (int y = 0; y < drawn.grid.height; ++y)
    for (int x = 0; x < drawn.grid.width; ++x) {
      const dem::MapPoint at = drawn.grid.point(x, y);
      out.products.height.push_back(map.direction(at) ? static_cast<float>(height_m(at))
                                                      : std::numeric_limits<float>::quiet_NaN());
    }
  if (request.rocks) out.products.rock_height.assign(out.products.height.size(), 0);
  const int margin = (drawn.grid.width - request.grid.width) / 2;
  for (const Vec2i& rock : rocks)
    out.products.rock_height[static_cast<std::size_t>((rock.y() + margin) * drawn.grid.width + rock.x() + margin)] = 1;
  out.warnings = find_hazards(request, drawn, out.products, StopToken());
  return out;
}

// Equirectangular, 2 km pixels, from a latitude southwards.
MapRequest along_a_meridian(double north_deg, int width, int height) {
  constexpr double kGsd_m = 2000;
  MapRequest request;
  request.grid = {{dem::MapProjection::equirectangular, 0, 0, kStandardParallel_deg},
                  -width * kGsd_m / 2,
                  north_deg * kMetresPerDegree,
                  kGsd_m,
                  width,
                  height};
  request.footprint = LanderFootprint{.diameter_m = 10000};
  request.products = kSlope;
  return request;
}

double lat_deg(const MapRequest& request, int row) { return request.grid.point(0, row).y_m / kMetresPerDegree; }

// Lengths along a parallel on the map over those on the ground.
double stretch(double lat_deg) {
  return std::cos(kStandardParallel_deg * kRadiansPerDegree) / std::cos(lat_deg * kRadiansPerDegree);
}

TEST(HazardMap, TheLimbTakesNoGroundWithIt) {
  constexpr int kSide = 360;
  constexpr double kGsd_m = 10000, kHalf_m = kSide * kGsd_m / 2;
  MapRequest request;
  request.grid = {{dem::MapProjection::orthographic, 0, 0, 0}, -kHalf_m, kHalf_m, kGsd_m, kSide, kSide};
  request.products = kSlope;
  for (const auto shape : {LanderFootprint::Shape::disc, LanderFootprint::Shape::square}) {
    request.footprint = LanderFootprint{.shape = shape, .diameter_m = 100000};
    const HazardsFound level = found(request, [](const dem::MapPoint&) { return 0.0; });
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x) {
        const dem::MapPoint at = request.grid.point(x, y);
        // Farther out a footprint is one pixel wide.
        if (std::hypot(at.x_m, at.y_m) > 0.93 * kMoonRadius_m) continue;
        ASSERT_LT(level.products.slope[static_cast<std::size_t>(kSide * y + x)], 1e-4F) << x << ' ' << y;
      }
    ASSERT_EQ(level.warnings.size(), 1U);
  }
}

// A tilt on the map is the steeper on the ground, the closer to the pole. The map's first 39 rows are beyond it.
TEST(HazardMap, SlopesAreThoseOfEachPixelsScaleUpToThePole) {
  constexpr double kTilt = 0.001;
  MapRequest request = along_a_meridian(92.6, 50, 200);
  const FrameProducts tilted = found(request, [](const dem::MapPoint& at) { return kTilt * at.x_m; }).products;
  int rows = 0;
  for (int y = 0; y < request.grid.height; ++y) {
    const double lat = lat_deg(request, y), from_pole_m = (90 - lat) * kMetresPerDegree;
    if (from_pole_m < 12000 || lat < 80.2) continue;
    ++rows;
    for (int x = 0; x < request.grid.width; ++x) {
      const double expected_deg = std::atan(kTilt * stretch(lat)) * kDegreesPerRadian;
      ASSERT_NEAR(static_cast<double>(tilted.slope[static_cast<std::size_t>(50 * y + x)]), expected_deg,
                  0.021 * expected_deg)
          << "latitude " << lat;
    }
  }
  EXPECT_GT(rows, 140);
}

TEST(HazardMap, ADiscIsStretchedAsTheMapIs) {
  MapRequest request = along_a_meridian(89, 140, 256);
  request.footprint->diameter_m = 20000;
  request.rocks = true;
  request.products = kRockCover;
  std::vector<Vec2i> rocks;
  for (int row = 5; row < 250; row += 30) rocks.emplace_back(70, row);
  const FrameProducts level = found(
                                  request, [](const dem::MapPoint&) { return 0.0; }, rocks)
                                  .products;
  for (const Vec2i& rock : rocks) {
    int wide = 0;
    for (int x = 0; x < 140; ++x) wide += level.rock_cover[static_cast<std::size_t>(140 * rock.y() + x)] > 0;
    EXPECT_NEAR(wide, 2 * std::floor(5 * stretch(lat_deg(request, rock.y()))) + 1, 2) << rock.y();
  }
}

TEST(HazardMap, WhereTheMapLeavesNoPlaneAWarningSaysSo) {
  const auto level = [](const dem::MapPoint&) { return 0.0; };
  EXPECT_TRUE(found(along_a_meridian(88, 50, 100), level).warnings.empty());
  // Half a footprint is less than a pixel wide below 79.96 degrees.
  const MapRequest request = along_a_meridian(82, 50, 100);
  const HazardsFound narrow = found(request, level);
  ASSERT_EQ(narrow.warnings.size(), 1U);
  std::size_t none = 0;
  for (const float slope : narrow.products.slope) none += std::isnan(slope);
  EXPECT_EQ(narrow.warnings[0].substr(0, narrow.warnings[0].find(' ')), std::to_string(none));
  for (int y = 0; y < 100; ++y) {
    if (std::abs(lat_deg(request, y) - 79.96) < 0.2) continue;
    EXPECT_EQ(std::isnan(narrow.products.slope[static_cast<std::size_t>(50 * y + 25)]), lat_deg(request, y) < 79.96);
  }
}

}  // namespace
}  // namespace selenograph::engine
