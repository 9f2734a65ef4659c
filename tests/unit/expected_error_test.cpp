#include "engine/scene/expected_error.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <vector>

#include "api/answers/metadata.h"
#include "engine/frame/accuracy.h"
#include "engine/frame/report.h"

namespace selenograph::engine {
namespace {

TEST(ExpectedMeshError, IsThe99thPercentileOverPixels) {
  // The worst block covers 1 % of the pixels, the next one 2 %.
  const std::vector<BlockError> blocks{{100, 9, 30}, {200, 5, 2}, {9700, 1, 1}};
  EXPECT_EQ(expected_error(blocks, &BlockError::error_px), 2);
  EXPECT_EQ(expected_error(blocks, &BlockError::error_m), 5);
  EXPECT_EQ(expected_error({{101, 9, 30}, {9899, 1, 1}}, &BlockError::error_px), 30);
  EXPECT_EQ(expected_error({}, &BlockError::error_px), 0);
}

TEST(ExpectedMeshError, SineOfEmissionBoundsEveryPointOfTheBall) {
  const Vec3 centre_m(1.7374e6, 0, 0);
  const double radius_m = 1e4;
  for (const double azimuth_deg : {0.0, 20.0, 60.0, 89.0})
    for (const double distance_m : {1.1e4, 5e4, 1e6}) {
      const double angle = azimuth_deg * std::numbers::pi / 180;
      const Vec3 camera_m = centre_m + distance_m * Vec3(std::cos(angle), std::sin(angle), 0);
      const double bound = largest_sine_of_emission(camera_m, centre_m, radius_m);
      for (const Vec3& offset : {Vec3(1, 0, 0), Vec3(-1, 0, 0), Vec3(0, 1, 0), Vec3(0, -1, 0), Vec3(0, 0, 1)}) {
        const Vec3 point_m = centre_m + radius_m * offset;
        const double emission = angle_between(camera_m - point_m, point_m);
        if (emission < std::numbers::pi / 2) {
          EXPECT_GE(bound, std::sin(emission) - 1e-12);
        }
      }
      EXPECT_LE(bound, 1);
    }
  // Seen from far above, a vertical error hardly moves a point in the image.
  EXPECT_LT(largest_sine_of_emission(centre_m + Vec3(1e6, 0, 0), centre_m, radius_m), 0.02);
}

TEST(ExpectedMeshError, WarningsAreByItAndNotByTheBound) {
  Accuracy accuracy;
  accuracy.max_error_px = 0.5;
  accuracy.max_detail_error_px = 4;
  FrameReport report;
  report.shadow_limits_px = {accuracy.max_shadow_error_px};
  report.lod_error_px = 28;
  report.expected_error_px = 0.2;
  nlohmann::ordered_json warnings = nlohmann::ordered_json::array();
  api::warn_of_relaxed_targets(accuracy, report, warnings);
  EXPECT_TRUE(warnings.empty()) << warnings;
  report.expected_error_px = 5;
  api::warn_of_relaxed_targets(accuracy, report, warnings);
  ASSERT_EQ(warnings.size(), 1U);
  EXPECT_NE(warnings[0].get<std::string>().find("more than 5 px (lod_error_p99_px), where 4 px"), std::string::npos);
}

}  // namespace
}  // namespace selenograph::engine
