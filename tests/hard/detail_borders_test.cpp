// Contrast on both sides of borders between levels of detail: what a level leaves out must not be seen as an edge.
// The same ground is looked at with both levels, where a border is: two windows beside it differ by themselves.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <unordered_set>
#include <vector>

#include "api/assets/assets.h"
#include "dem/detail/detail.h"
#include "dem/terrain/surface_place.h"
#include "engine/camera/view.h"
#include "engine/renderer.h"
#include "engine/scene/selection.h"
#include "tests/support/effort.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::engine {
namespace {

// Level ground of posts 118 m apart: all contrast is the detail's.
class DetailBorders : public testing::Test {
 protected:
  static constexpr int kSide = 1024, kWindow = 64;
  // Pixels whose level is asked for.
  static constexpr int kApart = 8, kAlong = kSide / kApart, kInWindow = kWindow / kApart;
  static constexpr double kLat = 10.2, kLon = 20.3;

  DetailBorders() {
    test::write_float_tile(folder_.path(), "level", {11, 19.5, 256, 385, 385}, [](double, double) { return 0; });
    renderer_ =
        std::make_unique<Renderer>(test::open_terrain(folder_.path()), RendererOptions{0, std::size_t{1} << 30});
    detail_ = std::make_shared<const dem::Detail>(
        api::read_detail_file(SELENOGRAPH_SOURCE_DIR "/deploy/assets/details/mare.json"));
  }

  // Looking north, so many degrees off the nadir, with the Sun in the east; so high above the ground.
  FrameRequest request(double lat_deg, double height_m, double tilt_deg, double sun_deg, double lon_deg = kLon) const {
    FrameRequest request;
    request.camera.width = request.camera.height = kSide;
    request.camera.fx = request.camera.fy = 1.1 * kSide, request.camera.cx = request.camera.cy = (kSide - 1) / 2.0;
    const double ground_m = renderer_->terrain_with(detail_)->height(lat_deg, lon_deg).height_m;
    request.pose.position_m = to_cartesian({lat_deg, lon_deg, ground_m + height_m});
    const EastNorthUp axes = local_axes(request.pose.position_m);
    Mat3 camera;
    camera.col(0) = axes.east, camera.col(1) = -axes.north, camera.col(2) = -axes.up;
    request.pose.camera_from_moon =
        (Quat(camera) * AngleAxis(tilt_deg * kRadiansPerDegree, Vec3::unit_x())).conjugate();
    const double sun = sun_deg * kRadiansPerDegree;
    request.sun.direction = (std::sin(sun) * axes.up + std::cos(sun) * axes.east).normalized();
    request.detail = detail_;
    request.products = kRadiance | kPosition;
    return request;
  }

  // Of every kApart-th pixel; 0 beyond the ground.
  std::vector<int> levels_of(const FrameRequest& asked, const Frame& frame) const {
    const auto terrain = renderer_->terrain_with(detail_);
    const View view(asked.camera, asked.pose);
    const Selection selection = select_for_view(*terrain, view, &asked.sun, asked.accuracy, {});
    const std::unordered_set<dem::BlockId, dem::BlockIdHash> chosen(selection.blocks.begin(), selection.blocks.end());
    std::vector<int> levels;
    for (int i = 0; i < kAlong * kAlong; ++i) {
      const int row = i / kAlong * kApart + kApart / 2, column = i % kAlong * kApart + kApart / 2;
      const double* p = frame.products.position.data() + 3 * static_cast<std::size_t>(row * kSide + column);
      levels.push_back(0);
      if (std::isnan(p[0])) continue;
      const Geographic at = to_geographic({p[0], p[1], p[2]});
      const dem::Ticks ticks = dem::ticks_of(at.lat_deg, at.lon_deg);
      for (int level = dem::kMaxLevel; level > 0 && levels.back() == 0; --level)
        if (chosen.contains(ticks.block(level))) levels.back() = level;
    }
    return levels;
  }

  // Geometric mean of windows' contrasts with the coarser of two levels over those with the finer one.
  struct Sides {
    double sum = 0;  // of logarithms
    int windows = 0;
    double ratio() const { return std::exp(sum / windows); }
    void add(const Sides& more) { sum += more.sum, windows += more.windows; }
  };

  // Of nine in ten of a window's places.
  static std::optional<int> level_in(const std::vector<int>& levels, int row, int column) {
    std::array<int, dem::kMaxLevel + 1> counts{};
    for (int r = 0; r < kInWindow; ++r)
      for (int c = 0; c < kInWindow; ++c)
        ++counts[static_cast<std::size_t>(
            levels[static_cast<std::size_t>((row / kApart + r) * kAlong + column / kApart + c)])];
    const auto most = std::max_element(counts.begin() + 1, counts.end());
    if (10 * *most < 9 * kInWindow * kInWindow) return std::nullopt;
    return static_cast<int>(most - counts.begin());
  }

  // RMS of a window's radiance over its mean.
  static double contrast(const Frame& frame, int row, int column) {
    double sum = 0, squares = 0;
    for (int r = 0; r < kWindow; ++r)
      for (int c = 0; c < kWindow; ++c) {
        const auto v =
            static_cast<double>(frame.products.radiance[static_cast<std::size_t>((row + r) * kSide + column + c)]);
        sum += v, squares += v * v;
      }
    constexpr double n = kWindow * kWindow;
    return std::sqrt(squares * n / (sum * sum) - 1);
  }

  // Windows that are beside a border: with a target a little larger they have the next coarser level.
  Sides sides_in(FrameRequest asked) const {
    const Frame fine = renderer_->render(asked);
    const std::vector<int> fine_levels = levels_of(asked, fine);
    constexpr double kLarger = 1.2;
    asked.accuracy.max_detail_error_px *= kLarger;
    const Frame coarse = renderer_->render(asked);
    const std::vector<int> coarse_levels = levels_of(asked, coarse);
    Sides sides;
    for (int r = 0; r + kWindow <= kSide; r += kWindow)
      for (int c = 0; c + kWindow <= kSide; c += kWindow)
        if (const auto level = level_in(fine_levels, r, c); level && level_in(coarse_levels, r, c) == *level - 1)
          sides.add({std::log(contrast(coarse, r, c) / contrast(fine, r, c)), 1});
    return sides;
  }

  // Windows on both sides of a border, one above the other in the image: the farther one over the nearer one.
  Sides across_in(const FrameRequest& asked) const {
    const Frame frame = renderer_->render(asked);
    const std::vector<int> levels = levels_of(asked, frame);
    Sides across;
    for (int r = 0; r + 2 * kWindow <= kSide; r += kApart)
      for (int c = 0; c + kWindow <= kSide; c += kWindow) {
        const auto far = level_in(levels, r, c), near = level_in(levels, r + kWindow, c);
        if (far && near && *far == *near - 1)
          across.add({std::log(contrast(frame, r, c) / contrast(frame, r + kWindow, c)), 1});
      }
    return across;
  }

  test::TemporaryFolder folder_;
  std::unique_ptr<Renderer> renderer_;
  std::shared_ptr<const dem::Detail> detail_;
};

// A level adds one octave of sizes, of about five that a window shows. (Finer ones would take more triangles than a
// frame of detail has.)
TEST_F(DetailBorders, ChangeTheContrastByOneOctave) {
  for (const double sun_deg : {5.0, 17.0, 40.0}) {
    if (sun_deg != 5 && !test::full_effort()) continue;  // a low Sun shows a border most
    Sides all;
    for (const auto& [height_m, tilt_deg] : {std::pair{1000.0, 0.0}, {3000.0, 55.0}, {300.0, 55.0}, {100.0, 70.0}}) {
      const Sides here = sides_in(request(kLat, height_m, tilt_deg, sun_deg));
      constexpr int kSome = 10;
      if (here.windows >= kSome) {
        EXPECT_GT(here.ratio(), 0.85) << sun_deg << ' ' << height_m << ' ' << tilt_deg;
      }
      all.add(here);
    }
    EXPECT_GT(all.windows, 50);
    EXPECT_GT(all.ratio(), 0.87) << sun_deg;
    EXPECT_LT(all.ratio(), 1) << sun_deg;  // it does add something
  }
}

// The finer level goes over into the coarser one. From 3 km and more, level ground shows three octaves of sizes or
// fewer, of which the coarser level lacks one; then what lies in the windows matters, too: several places.
TEST_F(DetailBorders, ContrastIsTheSameOnBothSides) {
  const std::vector<double> places{kLon, 20.1, 19.9};  // longitudes
  for (const double sun_deg : {5.0, 17.0, 40.0}) {
    if (sun_deg != 5 && !test::full_effort()) continue;
    for (const auto& [height_m, tilt_deg] :
         {std::pair{10000.0, 55.0}, {3000.0, 55.0}, {300.0, 55.0}, {100.0, 70.0}, {30.0, 70.0}}) {
      if (height_m != 3000 && height_m != 100 && !test::full_effort()) continue;  // one far, one near
      Sides across;
      for (const double lon_deg : height_m < 3000 ? std::vector{kLon} : places)
        across.add(across_in(request(kLat, height_m, tilt_deg, sun_deg, lon_deg)));
      EXPECT_GT(across.windows, 20) << height_m;
      EXPECT_NEAR(across.ratio(), 1, 0.1) << sun_deg << ' ' << height_m;
    }
  }
}

}  // namespace
}  // namespace selenograph::engine
