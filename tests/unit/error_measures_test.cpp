// Errors by hand: shadow edges, radiance, and points against terrain.
#include "engine/verify/error_measures.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "api/answers/accuracy_report.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

constexpr float kSky = std::numeric_limits<float>::quiet_NaN();
constexpr int kWidth = 40, kHeight = 30;

// Lit left of an upright edge.
std::vector<float> lit_left_of(int edge) {
  std::vector<float> lit;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) lit.push_back(x < edge ? 1.F : 0.F);
  return lit;
}

TEST(Spread, Quantiles) {
  std::vector<double> values;
  for (int i = 0; i <= 1000; ++i) values.push_back(1000 - i);
  const Spread s = spread_of(values);
  EXPECT_EQ(s.median, 500);
  EXPECT_EQ(s.p999, 999);
  EXPECT_EQ(s.worst, 1000);
  EXPECT_EQ(spread_of({}).worst, 0);
  EXPECT_EQ(spread_of({std::nan(""), 2}).median, 2);
}

TEST(ShadowEdges, DisplacedByThreePixels) {
  ErrorCollector errors;
  errors.add_shadows(kWidth, kHeight, lit_left_of(23), lit_left_of(20));
  const ErrorMeasures m = errors.result();
  EXPECT_DOUBLE_EQ(m.wrong_shadow_flags, 3.0 / kWidth);
  EXPECT_EQ(m.shadow_edge_px.worst, 2.5) << "the centre of the last wrong pixel lies half a pixel before the edge";
  EXPECT_EQ(m.shadow_edge_px.median, 1.5);
  // Of an upright edge the mean over all directions is pi / 4 of the truth's inverse.
  EXPECT_NEAR(m.shadow_edge_mean_px * std::numbers::pi / 4, 3, 1e-12);
}

TEST(ShadowEdges, NearestByAllDirections) {
  std::vector<float> lit(kWidth * kHeight, 0.F);
  lit[10 * kWidth + 13] = 1;  // three to the right and four up of (10, 14)
  EXPECT_DOUBLE_EQ(distance_to_flag(kWidth, kHeight, lit, 10, 14, true), 4.5);
  EXPECT_DOUBLE_EQ(distance_to_flag(kWidth, kHeight, lit, 13, 10, false), 0.5);
  lit[14 * kWidth + 14] = kSky;
  EXPECT_DOUBLE_EQ(distance_to_flag(kWidth, kHeight, lit, 10, 14, true), 4.5) << "sky is neither";
  EXPECT_DOUBLE_EQ(distance_to_flag(kWidth, kHeight, std::vector<float>(kWidth * kHeight, 0.F), 10, 14, true), 49.5)
      << "nowhere: the diagonal";
}

TEST(ShadowEdges, SkyIsCountedByItself) {
  std::vector<float> a = lit_left_of(20), b = a;
  a[5] = kSky;
  ErrorCollector errors;
  errors.add_shadows(kWidth, kHeight, a, b);
  EXPECT_EQ(errors.result().wrong_shadow_flags, 0);
  EXPECT_DOUBLE_EQ(errors.result().wrong_hits, 1.0 / (kWidth * kHeight));
}

TEST(RadianceErrors, RelativeToTheSunlitMean) {
  const std::vector<float> reference{4, 4, 0, 4}, measured{4, 5, 0, 4};
  ErrorCollector errors;
  errors.add_radiance(measured, reference);
  const ErrorMeasures m = errors.result();
  EXPECT_DOUBLE_EQ(m.radiance_rms, 0.5 / 4);
  EXPECT_DOUBLE_EQ(m.radiance_p999, 1.0 / 4);
}

TEST(GeometricErrors, AreThePointsDistancesFromTheTerrain) {
  const test::TemporaryFolder folder;
  test::write_float_tile(folder.path(), "t", {12, 22, 16, 33, 33}, [](double, double) { return 100.0; });
  const auto terrain = test::open_terrain(folder.path());
  const Pose pose = test::looking(to_cartesian({11, 23, 20000}), -to_cartesian({11, 23, 1}), Vec3::unit_z());
  const View view(test::square_camera(101, 40), pose);
  std::vector<double> points;
  for (const double height : {100.0, 103.0, 100.5}) {
    const Vec3 p = to_cartesian({11.1, 23, height});
    points.insert(points.end(), p.data(), p.data() + 3);
  }
  points.insert(points.end(), 3, std::nan(""));  // sky
  const auto low = view.project(to_cartesian({11.1, 23, 100})), high = view.project(to_cartesian({11.1, 23, 103}));
  const double three_metres_px = std::hypot(low->x - high->x, low->y - high->y);
  ErrorCollector errors;
  FrameReport report;
  report.lod_error_m = 1;
  report.lod_error_px = 1;
  report.expected_error_px = three_metres_px / 2;
  errors.add_geometry(view, *terrain, points, report);
  const ErrorMeasures m = errors.result();
  const double sag = 0.2;  // of chords of 1.9 km, at most
  EXPECT_NEAR(m.geometric_m.worst, 3, sag);
  EXPECT_NEAR(m.geometric_m.median, 0.5, sag);
  EXPECT_NEAR(m.within_bound_m, 2.0 / 3, 1e-12) << "three metres are beyond the bound of one";
  EXPECT_NEAR(m.geometric_px.worst, three_metres_px, 1e-3);
  EXPECT_EQ(m.within_bound_px, 1);
  EXPECT_NEAR(m.within_expected_px, 2.0 / 3, 1e-12);
}

}  // namespace
}  // namespace selenograph::engine

namespace selenograph::api {
namespace {

std::vector<engine::SweepRow> two_rows() {
  std::vector<engine::SweepRow> rows(2);
  for (engine::SweepRow& r : rows) r.scene = "nadir", r.bare_ms = 10, r.frame_ms = 5;
  rows[1].setting.max_error_px = 0.25, rows[1].frame_ms = 20;
  rows[0].errors.radiance_rms = 0.04, rows[1].errors.radiance_rms = 0.01;
  return rows;
}

TEST(AccuracyReport, CsvHasAColumnForEachMeasure) {
  const std::string csv = accuracy_csv(two_rows());
  const auto lines = std::count(csv.begin(), csv.end(), '\n');
  EXPECT_EQ(lines, 3);
  const std::string head = csv.substr(0, csv.find('\n')),
                    first = csv.substr(head.size() + 1, csv.find('\n', head.size() + 1) - head.size() - 1);
  EXPECT_EQ(std::count(head.begin(), head.end(), ','), std::count(first.begin(), first.end(), ','));
  EXPECT_TRUE(head.starts_with("scene,visibility,max_error_px,samples_per_pixel"));
  EXPECT_TRUE(first.starts_with("nadir,raytrace,0.5,1"));
}

TEST(AccuracyReport, JsonSaysWhatTheRowsBelongTo) {
  const nlohmann::ordered_json json = accuracy_json({{"nadir", "straight down", {}}}, "a machine");
  EXPECT_EQ(json["machine"], "a machine");
  EXPECT_EQ(json["scenes"][0]["description"], "straight down");
  EXPECT_EQ(json["default"]["max_error_px"], engine::Accuracy{}.max_error_px);
}

}  // namespace
}  // namespace selenograph::api
