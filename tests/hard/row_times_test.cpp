// Rows with times over the sample terrain: without motion the frame is the plain one, each row is what a camera at rest
// in that row's pose sees, and what a strip sees is projected back into it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include "dem/base/error.h"
#include "dem/gdal/geotiff_writer.h"
#include "dem/value_maps/value_map.h"
#include "engine/camera/pose_track.h"
#include "engine/visibility/objects/object_mesh.h"
#include "tests/support/effort.h"
#include "tests/support/meshes.h"
#include "tests/support/queries.h"
#include "tests/support/same_bytes.h"
#include "tests/support/sample_scenery.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

using test::at3;
using test::kDegree;
using test::local_sun;

constexpr ProductSet kAllProducts = kRadiance | kImage | kDepth | kRange | kPosition | kGeodetic | kNormal | kAngles |
                                    kLit | kGsd | kSource | kObjectId | kDetail;

class RowTimes : public test::SampleScenery {
 protected:
  // Straight down from above the middle of the south of the tiles, image up southward, so that the camera's way, to the
  // north, is down in the image.
  static Pose start(double height_m) {
    const Vec3 from = to_cartesian({-10.85, 44.1, height_m});
    return test::looking(from, -from, -local_axes(from).north);
  }
  static FrameRequest request(int width, int height) {
    FrameRequest request;
    request.camera = {width, height, 2000, 2000, (width - 1) / 2.0, (height - 1) / 2.0, {}};
    request.pose = start(30000);
    request.sun = {local_sun(-10, 44, 70, 12), 1, 0};
    request.visibility = Visibility::raytrace;
    request.products = kAllProducts;
    return request;
  }
  static Vec3 north() { return local_axes(start(0).position_m).north; }
  static const Renderer& renderer() { return *scenery().renderer; }
};

TEST_F(RowTimes, WithoutMotionTheFrameIsThePlainOne) {
  for (const bool lens : {false, true})
    for (const int samples : {1, 4}) {
      FrameRequest plain = request(120, 90);
      if (lens) plain.camera.distortion = {-0.3, 0.1, 0, 0.001, 0.002};
      plain.accuracy.samples_per_pixel = samples;
      FrameRequest rows = plain;
      rows.shutter.emplace();
      rows.shutter->line_time_s = 0.01;
      const Frame a = renderer().render(plain), b = renderer().render(rows);
      EXPECT_EQ(b.report.visibility, Visibility::raytrace);
      EXPECT_EQ(a.report.hit_fraction, 1);
      EXPECT_GT(*std::max_element(a.products.image.begin(), a.products.image.end()), 0);
      EXPECT_TRUE(test::same_bytes(a.products, b.products)) << lens << " " << samples;
      EXPECT_EQ(a.report.lod_error_px, b.report.lod_error_px);
      EXPECT_EQ(a.report.triangles, b.report.triangles);
    }
}

// --- by z-buffer

// Motions during the readout of a frame, each of about the same number of pixels, and all at once.
std::vector<std::pair<std::string, Rates>> motions(const FrameRequest& r, double height_m, double motion_px) {
  const double readout_s = r.shutter->line_time_s * r.camera.height;
  const double turn_deg_s = motion_px / r.camera.fx / kDegree / readout_s;
  const double speed_m_s = motion_px / r.camera.fx * height_m / readout_s;
  const double half_height = r.camera.height / 2.0;
  const double to_end = r.camera.fx / half_height;  // motion at the end of the image, by its angle
  const double descent_m_s = height_m * motion_px / (half_height + motion_px) / readout_s;
  const auto [east, north, up] = local_axes(r.pose.position_m);
  return {{"pitch", {Vec3(turn_deg_s, 0, 0), Vec3::zero()}},
          {"pitch backward", {Vec3(-turn_deg_s, 0, 0), Vec3::zero()}},
          {"yaw", {Vec3(0, turn_deg_s, 0), Vec3::zero()}},
          {"roll", {Vec3(0, 0, to_end * turn_deg_s), Vec3::zero()}},
          {"flight along the rows' order", {Vec3::zero(), speed_m_s * north}},
          {"flight across", {Vec3::zero(), speed_m_s * east}},
          {"descent", {Vec3::zero(), -descent_m_s * up}},
          {"all", {0.3 * turn_deg_s * Vec3(1, -1, to_end), 0.3 * (speed_m_s * (north + east) - descent_m_s * up)}}};
}

// Renders a request by both algorithms, and counts the pixels whose points or light differ.
struct Differences {
  std::size_t pixels = 0, points = 0, light = 0, holes = 0;  // holes: among pixels that rays hit
};
// Returns whether the pixel and its eight neighbours have a depth.
bool hits_around(const std::vector<double>& depth, std::size_t pixel, std::size_t width) {
  for (const std::size_t row : {pixel - width, pixel, pixel + width})
    for (const std::size_t i : {row - 1, row, row + 1})
      if (i < depth.size() && std::isnan(depth[i])) return false;
  return true;
}
Differences compare_both_ways(const Renderer& renderer, FrameRequest request) {
  request.products = kRadiance | kDepth | kPosition | kLit;
  request.visibility = Visibility::raytrace;
  const Frame rays = renderer.render(request);
  request.visibility = Visibility::automatic;
  const Frame drawn = renderer.render(request);
  EXPECT_EQ(rays.report.visibility, Visibility::raytrace);
  EXPECT_EQ(drawn.report.visibility, Visibility::zbuffer);
  const FrameProducts &a = rays.products, &b = drawn.products;
  Differences d;
  d.pixels = a.depth.size();
  for (std::size_t i = 0; i < d.pixels; ++i) {
    if (std::isnan(a.depth[i]) || std::isnan(b.depth[i])) {
      const bool differs = std::isnan(a.depth[i]) != std::isnan(b.depth[i]);
      d.points += differs;  // on the terrain's outline, unless it is a hole
      d.holes += differs && hits_around(a.depth, i, static_cast<std::size_t>(request.camera.width));
      continue;
    }
    const bool same_point = (at3(a.position, i) - at3(b.position, i)).norm() <= 1e-3;
    d.points += !same_point;
    d.light += same_point && a.lit[i] != b.lit[i];
    if (same_point && a.lit[i] == b.lit[i]) {
      EXPECT_NEAR(a.radiance[i], b.radiance[i], 1e-5F * (1 + a.radiance[i])) << i;
    }
  }
  return d;
}

// At silhouettes a pixel in some thousands sees the ground before them by one algorithm, that behind them by the other.
TEST_F(RowTimes, TheZBufferSeesWhatRaysSee) {
  Differences all;
  for (const double motion_px : {5.0, 60.0, 200.0})
    for (const bool oblique : {false, true}) {
      // The small motion straight down, the large one obliquely.
      if ((motion_px == 60 || oblique != (motion_px == 200)) && !test::full_effort()) continue;
      FrameRequest r = request(320, 1024);
      r.camera.fx = r.camera.fy = 1000;
      if (oblique) {
        const auto [east, north, up] = local_axes(r.pose.position_m);
        r.pose = test::looking(r.pose.position_m, 1.5 * north - up, up);
      }
      r.shutter.emplace();
      r.shutter->line_time_s = 0.001;
      for (const auto& [name, rates] : motions(r, 30000, motion_px)) {
        r.shutter->rates = rates;
        const Differences d = compare_both_ways(renderer(), r);
        EXPECT_EQ(d.holes, 0U) << name << " " << motion_px << " " << oblique;
        EXPECT_LE(d.points, 4U) << name << " " << motion_px << " " << oblique;
        EXPECT_LE(d.light * 10000, d.pixels) << name << " " << motion_px << " " << oblique;
        all.pixels += d.pixels;
        all.points += d.points;
        all.light += d.light;
      }
    }
  std::printf("z-buffer against rays: %zu pixels, %zu points and %zu light flags differ\n", all.pixels, all.points,
              all.light);
  EXPECT_LE(all.points * 100000, all.pixels);
}

TEST_F(RowTimes, TheZBufferSeesThroughALensWhatRaysSee) {
  FrameRequest r = request(256, 320);
  r.camera.fx = r.camera.fy = 500;
  r.camera.distortion = {-0.3, 0.1, 0, 0.001, 0.002};
  r.shutter.emplace();
  r.shutter->line_time_s = 0.001;
  for (const auto& [name, rates] : motions(r, 30000, 6)) {
    r.shutter->rates = rates;
    const Differences d = compare_both_ways(renderer(), r);
    EXPECT_EQ(d.holes, 0U) << name;
    EXPECT_LE(d.points, 2U) << name;
    EXPECT_LE(d.light * 10000, d.pixels) << name;
  }
}

TEST_F(RowTimes, TheZBufferDrawsSubPixelSamplesAndTheSunsDiscAsRaysDo) {
  FrameRequest r = request(160, 160);
  r.shutter.emplace();
  r.shutter->line_time_s = 0.001;
  r.shutter->rates = {Vec3(2, 1, -3), 1600 * north()};
  for (const int samples : {1, 4, 9})
    for (const double radius_deg : {0.0, 0.2666}) {
      r.accuracy.samples_per_pixel = samples;
      r.sun.angular_radius_deg = radius_deg;
      r.products = kRadiance;
      r.visibility = Visibility::raytrace;
      const std::vector<float> rays = renderer().render(r).products.radiance;
      r.visibility = Visibility::zbuffer;
      const std::vector<float> drawn = renderer().render(r).products.radiance;
      const float max_radiance = *std::max_element(rays.begin(), rays.end());
      std::size_t differ = 0;
      for (std::size_t i = 0; i < rays.size(); ++i) differ += std::abs(rays[i] - drawn[i]) > 0.03F * max_radiance;
      EXPECT_LE(differ * 1000, rays.size()) << samples << " " << radius_deg;
    }
}

TEST_F(RowTimes, RowsThatTheZBufferCannotDrawAreRayTraced) {
  const auto visibility = [](const FrameRequest& r) { return renderer().render(r).report.visibility; };
  FrameRequest slow = request(96, 96);
  slow.visibility = Visibility::automatic;
  slow.shutter.emplace();
  slow.shutter->line_time_s = 0.001;
  slow.shutter->rates = {Vec3(0, 0, 3), 1600 * north()};
  EXPECT_EQ(visibility(slow), Visibility::zbuffer);
  FrameRequest fast = slow;
  fast.shutter->line_time_s = 0.1;
  EXPECT_EQ(visibility(fast), Visibility::raytrace);
  fast.visibility = Visibility::zbuffer;
  EXPECT_THROW(renderer().render(fast), ImpossibleRequest);
  FrameRequest fisheye = slow;
  fisheye.camera.model = CameraModel::fisheye;
  EXPECT_EQ(visibility(fisheye), Visibility::raytrace);
  FrameRequest line = slow;
  line.shutter->pushbroom = true;
  EXPECT_EQ(visibility(line), Visibility::raytrace);
}

// A point spread's margin is rows before the first one and after the last one.
TEST_F(RowTimes, WithoutMotionTheSensorImageIsThePlainOne) {
  FrameRequest plain = request(80, 60);
  plain.products = kImage | kDepth;
  plain.band = Band{{{0.6, 1}, {0.7, 1}}};
  SensorModel& sensor = plain.sensor.emplace();
  sensor.optics.f_number = 4, sensor.optics.point_spread.model = PointSpread::Model::gaussian;
  sensor.optics.point_spread.sigma_px = 0.8, sensor.optics.vignetting.model = Vignetting::Model::cos4;
  sensor.detector.pixel_pitch_um = 5.5, sensor.detector.integration_time_s = 0.002, sensor.detector.bit_depth = 12;
  sensor.detector.gain_e_dn = 4, sensor.detector.prnu = 0.02, sensor.detector.read_noise_e = 10;
  FrameRequest rows = plain;
  rows.shutter.emplace();
  rows.shutter->line_time_s = 0.01;
  const Frame a = renderer().render(plain), b = renderer().render(rows);
  EXPECT_GT(a.report.margin_px, 1);
  EXPECT_GT(*std::max_element(a.products.image.begin(), a.products.image.end()), 50);
  EXPECT_TRUE(test::same_bytes(a.products, b.products));
  // In motion the margin doesn't change what the image's rows see.
  rows.shutter->rates = {Vec3(0, 0, 3), 1600 * north()};
  FrameRequest bare = rows;
  bare.sensor.reset(), bare.products = kDepth;
  rows.accuracy.max_error_px = bare.accuracy.max_error_px = 0;
  const Frame with = renderer().render(rows), without = renderer().render(bare);
  for (std::size_t i = 0; i < with.products.depth.size(); ++i)
    ASSERT_NEAR(with.products.depth[i], without.products.depth[i], 1e-6) << i;  // a row's way is 10 m
}

// Of two arrays how many of one row's values differ, NaNs being alike.
template <typename T>
std::size_t differing(const std::vector<T>& a, const std::vector<T>& b, std::size_t row_a, std::size_t row_b,
                      std::size_t pixels_a, std::size_t width, std::size_t& compared) {
  if (a.empty() != b.empty()) return width;
  if (a.empty()) return 0;
  const std::size_t row = a.size() / pixels_a * width;
  std::size_t count = 0;
  for (std::size_t i = 0; i < row; ++i) {
    const T x = a[row_a * row + i], y = b[row_b * row + i];
    count += !(x == y || (x != x && y != y));
  }
  compared += row;
  return count;
}

// The finest posts everywhere, so that both have the same terrain.
void expect_rows_of_cameras_at_rest(const Renderer& renderer, FrameRequest moving, const std::vector<int>& rows) {
  moving.accuracy.max_error_px = 0;
  const Frame all = renderer.render(moving);
  const auto width = static_cast<std::size_t>(moving.camera.width);
  const PoseTrack track(moving.pose, *moving.shutter);
  for (const int row : rows) {
    FrameRequest rest = moving;
    rest.shutter.reset();
    rest.pose = track.at(row * moving.shutter->line_time_s);
    if (moving.shutter->pushbroom) rest.camera.height = 1, rest.camera.cy = 0;
    const Frame one = renderer.render(rest);
    const std::size_t there = moving.shutter->pushbroom ? 0 : static_cast<std::size_t>(row);
    const auto here = static_cast<std::size_t>(row);
    std::size_t differ = 0, compared = 0, arrays = 0;
    const auto compare = [&](const auto& a, const auto& b) {
      differ += differing(a, b, here, there, all.products.radiance.size(), width, compared), ++arrays;
    };
    std::apply(
        [&](const auto&... a) {
          std::apply([&](const auto&... b) { (compare(a, b), ...); }, all_arrays(one.products));
        },
        all_arrays(all.products));
    EXPECT_EQ(differ, 0U) << "row " << row << " of " << compared << " values";
    EXPECT_GE(compared, 15 * width);
    EXPECT_EQ(arrays, std::tuple_size_v<decltype(all_arrays(all.products))>);
  }
}

TEST_F(RowTimes, ARollingShuttersRowsAreThoseOfCamerasAtRest) {
  FrameRequest moving = request(96, 96);
  moving.image.full_scale_radiance_w_m2_sr = 30;
  moving.shutter.emplace();
  moving.shutter->line_time_s = 0.01;
  moving.shutter->rates = {Vec3(1, -2, 5), 1600 * north() + Vec3(20, -30, 40)};
  expect_rows_of_cameras_at_rest(renderer(), moving, {0, 1, 2, 37, 94, 95});
  moving.camera.distortion = {-0.3, 0.1, 0, 0.001, 0.002};
  expect_rows_of_cameras_at_rest(renderer(), moving, {0, 41, 95});
  moving.camera.distortion = {};
  moving.camera.model = CameraModel::fisheye;
  expect_rows_of_cameras_at_rest(renderer(), moving, {0, 50, 95});
}

// An object that stands in the way of some rows, and a map whose values are means over what each pixel covers.
FrameRequest with_object_and_map(FrameRequest request, const Vec3& north, const test::TemporaryFolder& folder) {
  constexpr int kSide = 1500;
  std::vector<float> values;
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) values.push_back(0.05F + 0.2F * static_cast<float>((x * 7 + y * 13) % 29) / 29);
  dem::write_geotiff(folder / "albedo.tif", {-9.2, 43.95, 0.0002, 0.0002, kSide, kSide}, values, "albedo");
  dem::ValueMapOptions options;
  options.path = folder / "albedo.tif";
  request.pose.position_m += 45000 * north;
  request.albedo_maps = {
      std::make_shared<const dem::ValueMap>(options, dem::make_value_map_tiles(std::size_t{64} << 20))};
  const auto mesh = std::make_shared<const ObjectMesh>(
      test::read_shape(SELENOGRAPH_SOURCE_DIR "/deploy/assets/objects/satellite.obj"));
  const Vec3 below = request.pose.position_m.normalized() * (kMoonRadius_m + 28000) + 900 * north;
  SceneObject object{mesh, below, Quat(0.5, 0.5, 0.5, 0.5), 30, {}};
  object.materials.resize(mesh->shape().parts.size());
  request.objects = {object};
  request.shutter.emplace();
  return request;
}

TEST_F(RowTimes, ObjectsAndMapsAreSeenFromTheRowsPose) {
  const test::TemporaryFolder folder;
  FrameRequest moving = with_object_and_map(request(96, 96), north(), folder);
  moving.image.full_scale_radiance_w_m2_sr = 30;
  moving.shutter->line_time_s = 0.01;
  moving.shutter->rates = {Vec3(0, 0, 8), 1600 * north()};
  std::size_t on_object = 0;
  for (const bool pushbroom : {false, true}) {
    moving.shutter->pushbroom = pushbroom;
    const std::vector<std::uint16_t> seen = renderer().render(moving).products.object_id;
    on_object += static_cast<std::size_t>(std::count(seen.begin(), seen.end(), 0));
    expect_rows_of_cameras_at_rest(renderer(), moving, {0, 30, 45, 50, 60, 95});
  }
  EXPECT_GT(on_object, 200U);
}

TEST_F(RowTimes, ObjectsAndMapsAreTheSameByZBuffer) {
  const test::TemporaryFolder folder;
  FrameRequest moving = with_object_and_map(request(96, 96), north(), folder);
  moving.pose.position_m += 840 * north();
  moving.shutter->line_time_s = 0.001;
  moving.shutter->rates = {Vec3(0, 0, 8), 1600 * north()};
  const Differences d = compare_both_ways(renderer(), moving);
  EXPECT_EQ(d.holes, 0U);
  EXPECT_LE(d.points, 2U);
  EXPECT_LE(d.light, 2U);
  moving.visibility = Visibility::zbuffer;
  const std::vector<std::uint16_t> seen = renderer().render(moving).products.object_id;
  EXPECT_GT(std::count(seen.begin(), seen.end(), 0), 100);
}

TEST_F(RowTimes, APushbroomsRowsAreThoseOfLineCameras) {
  FrameRequest moving = request(96, 300);
  moving.image.full_scale_radiance_w_m2_sr = 30;
  moving.shutter.emplace();
  moving.shutter->line_time_s = 0.01, moving.shutter->pushbroom = true;
  moving.shutter->rates = {Vec3(0.05, 0, 0.2), 1600 * north()};
  expect_rows_of_cameras_at_rest(renderer(), moving, {0, 1, 150, 151, 299});
}

// --- strips of 4096 rows

// Of 64 columns of 10 m, 40 km long.
FrameRequest strip(FrameRequest request) {
  request.camera = {64, 4096, 3000, 3000, 31.5, 2047.5, {}};
  request.shutter.emplace();
  request.shutter->line_time_s = 10.0 / 1600, request.shutter->pushbroom = true;
  request.products = kGeodetic | kLit | kDepth;
  return request;
}

// What the pixels see, projected back: the largest distances from where it was seen, in columns and in rows.
void expect_closure(const Renderer& renderer, const FrameRequest& request) {
  const Frame frame = renderer.render(request);
  EXPECT_GT(frame.report.hit_fraction, 0.999);
  EXPECT_LE(frame.report.lod_error_px, request.accuracy.max_error_px);
  std::vector<LandmarkQuery> places;
  std::vector<std::size_t> pixels;
  for (std::size_t i = 0; i < frame.products.depth.size(); i += 7) {
    if (std::isnan(frame.products.depth[i])) continue;
    const Vec3 g = at3(frame.products.geodetic, i);
    places.push_back({g.x(), g.y(), g.z()}), pixels.push_back(i);
  }
  ASSERT_GT(places.size(), 30000U);
  const auto marks = test::project_landmarks(renderer, request, places, request.sun);
  double off_x = 0, off_y = 0;
  std::size_t visible = 0, of_same_light = 0;
  for (std::size_t k = 0; k < marks.size(); ++k) {
    const Landmark& mark = marks[k];
    const double x = static_cast<double>(pixels[k] % 64), y = static_cast<double>(pixels[k] / 64);
    ASSERT_TRUE(mark.in_frame) << x << " " << y;
    off_x = std::max(off_x, std::abs(mark.x_px - x)), off_y = std::max(off_y, std::abs(mark.y_px - y));
    ASSERT_NEAR(mark.time_s, y * request.shutter->line_time_s, 0.01 * request.shutter->line_time_s);
    visible += mark.visible;
    of_same_light += mark.lit == static_cast<double>(frame.products.lit[pixels[k]]);
  }
  EXPECT_LT(off_x, 0.01);
  EXPECT_LT(off_y, 0.01);
  // The landmarks' terrain is the finest, the frame's is as fine as its pixels: what is seen may be slightly buried.
  const auto all = static_cast<double>(marks.size());
  std::printf("closure: x %.2g px, y %.2g px, visible %.4f, lit alike %.4f, %zu triangles, lod %.3f px\n", off_x, off_y,
              static_cast<double>(visible) / all, static_cast<double>(of_same_light) / all, frame.report.triangles,
              frame.report.lod_error_px);
}

TEST_F(RowTimes, AStripClosesWhileTheCameraTurns) {
  FrameRequest r = strip(request(64, 64));
  // Down stays down over 1.3 degrees of the Moon; the line turns about the boresight.
  r.shutter->rates = {Vec3(1600 / (kMoonRadius_m + 30000) / kDegree, 0.01, 0.3), 1600 * north()};
  expect_closure(renderer(), r);
}

TEST_F(RowTimes, AStripClosesThroughPosesWithALens) {
  FrameRequest r = strip(request(64, 64));
  r.camera.distortion = {-0.3, 0.1, 0, 0.001, 0.002};
  const double speed = 1600 / (kMoonRadius_m + 30000);
  for (int i = 0; i <= 9; ++i) {
    const double time_s = 3 * i - 0.5 + 0.2 * (i % 3), angle = speed * time_s;
    const Vec3 up = start(0).position_m.normalized(), along = north();
    const Vec3 zenith = std::cos(angle) * up + std::sin(angle) * along,
               ahead = std::cos(angle) * along - std::sin(angle) * up;
    Pose pose = test::looking((kMoonRadius_m + 30000 + 200 * std::sin(0.3 * i)) * zenith, -zenith, -ahead);
    // A tenth of a degree of unrest.
    pose.camera_from_moon =
        AngleAxis(0.1 * kDegree * std::sin(2.0 * i), Vec3(1, 2, 3).normalized()) * pose.camera_from_moon;
    r.shutter->poses.push_back({time_s, pose});
  }
  r.pose = PoseTrack({}, *r.shutter).at(0);
  expect_closure(renderer(), r);
}

// The bound on the error of coarser terrain, pixel by pixel, in every row: what was hit against the finest surface.
TEST_F(RowTimes, TheErrorBoundHoldsInEveryRow) {
  FrameRequest r = strip(request(64, 64));
  r.camera.height = 800, r.camera.fx = r.camera.fy = 500;  // 60 m a pixel
  r.shutter->rates = {Vec3(1600 / (kMoonRadius_m + 30000) / kDegree, 0, 0), 1600 * north()};
  r.shutter->line_time_s = 0.03;
  for (const double max_error_px : {0.5, 2.0}) {
    r.accuracy.max_error_px = max_error_px;
    const Frame frame = renderer().render(r);
    EXPECT_GT(frame.report.lod_error_px, 0.2 * max_error_px);
    EXPECT_LE(frame.report.lod_error_px, max_error_px);
    double worst_px = 0;
    for (std::size_t i = 0; i < frame.products.depth.size(); i += 11) {
      const Vec3 g = at3(frame.products.geodetic, i);
      const double finest_m = scenery().terrain->height(g.x(), g.y()).height_m;
      worst_px = std::max(worst_px, std::abs(finest_m - g.z()) * r.camera.fx / frame.products.depth[i]);
    }
    EXPECT_GT(worst_px, 0.01);
    EXPECT_LE(worst_px, frame.report.lod_error_px + 1e-3);
    std::printf("of %.3g px: bound %.3f px, worst %.3f px\n", max_error_px, frame.report.lod_error_px, worst_px);
  }
}

TEST_F(RowTimes, TheCameraMustBeAboveTheGroundInEveryRow) {
  FrameRequest r = request(32, 400);
  r.shutter.emplace();
  r.shutter->line_time_s = 0.1, r.shutter->pushbroom = true;
  r.shutter->rates.velocity_m_s = -1000 * r.pose.position_m.normalized();
  try {
    renderer().render(r);
    FAIL() << "row 300 is in the ground";
  } catch (const ImpossibleRequest& e) {
    EXPECT_EQ(e.member(), "shutter");
    EXPECT_NE(std::string(e.what()).find("in row "), std::string::npos) << e.what();
  }
}

TEST_F(RowTimes, ADeadlineEndsAStrip) {
  FrameRequest r = strip(request(64, 64));
  r.shutter->rates = {Vec3::zero(), 1600 * north()};
  EXPECT_THROW(renderer().render(r, StopToken(StopToken::Clock::now())), Cancelled);
}

}  // namespace
}  // namespace selenograph::engine
