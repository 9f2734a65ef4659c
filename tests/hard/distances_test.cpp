// A camera from 2 m above the ground to 400 000 km away, judged in double precision; and no jump where the scene's
// anchor changes.
//
// Positions are judged twice: brought back into the image by a pinhole written down here, against the pixel's centre,
// and along the ray against the judge's distance. Both must be right to double's rounding at every height.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "dem/terrain/pyramid_terrain.h"
#include "engine/renderer.h"
#include "engine/scene/anchor.h"
#include "engine/scene/selection.h"
#include "tests/support/judge.h"
#include "tests/support/queries.h"
#include "tests/support/shared_data.h"
#include "tests/support/tiles.h"
#include "tests/support/views.h"

namespace selenograph::test {
namespace {

constexpr int kSmallSide = 48;  // pixels
constexpr double kTileLat = 9.5, kTileLon = 30.5;

// What double allows: a few units in the last place of what is subtracted from each other, coordinates of the Moon's
// radius and the range itself. (One is 2.3e-10 m at the Moon's radius and 6e-8 m at 400 000 km.) A plane that is met
// at a slant of 20 degrees and steeper stretches it by up to 3.
double rounding_m(double range_m) { return 3 * (8 * 2.4e-10 + 4 * 0x1p-53 * range_m); }

// The pinhole of the frame contract, on its own: quaternion, axes and pixel centres from the contract's words.
struct Pinhole {
  const engine::Camera& camera;
  const engine::Pose& pose;

  Vec3 turned(const Vec3& v, double direction) const {
    const Quat& q = pose.camera_from_moon;
    const Vec3 axis = direction * q.vec();
    return v + 2 * q.w * axis.cross(v) + 2 * axis.cross(axis.cross(v));
  }
  Vec3 ray(int pixel) const {
    const double x = (pixel % camera.width - camera.cx) / camera.fx, y = (pixel / camera.width - camera.cy) / camera.fy;
    return turned({x, y, 1}, -1).normalized();
  }
  double pixels_off(int pixel, const Vec3& point_m) const {
    const Vec3 p = turned(point_m - pose.position_m, 1);
    return std::hypot(camera.fx * p.x() / p.z() + camera.cx - pixel % camera.width,
                      camera.fy * p.y() / p.z() + camera.cy - pixel / camera.width);
  }
};

struct Errors {
  int hits = 0, outlines = 0;
  double px = 0, range_m = 0, off_terrain_m = 0, farthest_m = 0;
  std::vector<double> range_error_m;  // signed, per pixel; NaN where there is none
};

class Distances : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    // Slopes up to 20 degrees, posts of 59 m.
    write_kaguya_tile(folder_->path(), 10, 30, 1, 512, [](double lat, double lon) {
      return 150 * std::sin(38 * lat) * std::cos(41 * lon) + 60 * std::sin(150 * lat + 110 * lon);
    });
    judge_ = new Judge(folder_->path());
    renderer_ =
        new engine::Renderer(std::make_shared<dem::PyramidTerrain>(
                                 dem::Catalogue(std::vector<std::string>{folder_->path()}), dem::TerrainOptions{}),
                             {1, std::size_t{256} << 20});
  }
  static void TearDownTestSuite() {
    delete renderer_, delete judge_, delete folder_;
    renderer_ = nullptr, judge_ = nullptr, folder_ = nullptr;
  }
  static const engine::Renderer& renderer() { return *renderer_; }
  static const Judge& judge() { return *judge_; }
  static double ground_m(const Vec3& p) {
    const Geographic g = to_geographic(p);
    return renderer_->terrain().height(g.lat_deg, g.lon_deg).height_m;
  }
  static Vec3 centre() {
    const Vec3 place = to_cartesian({kTileLat, kTileLon, 0});
    return place * (1 + ground_m(place) / kMoonRadius_m);
  }

  // Looking at the tile's centre, `tilt_deg` from straight down toward the west; never more than 10 km of it in view.
  static engine::FrameRequest request_at(double height_m, double tilt_deg) {
    const EastNorthUp axes = local_axes(centre());
    const double tilt = tilt_deg * kDegree;
    const Vec3 boresight = -std::sin(tilt) * axes.east - std::cos(tilt) * axes.up;
    Vec3 position = centre() - boresight * (height_m / std::cos(tilt));
    if (height_m < 10000) {  // over the tile: so high above the ground that is there
      const Geographic g = to_geographic(position);
      position = to_cartesian({g.lat_deg, g.lon_deg, ground_m(position) + height_m});
    }
    engine::FrameRequest q = blank_request();
    q.camera = square_camera(kSmallSide, std::min(60.0, 2 * std::atan(5000 / height_m) / kDegree));
    q.pose = looking(position, boresight, axes.north);
    q.accuracy.max_error_px = 0;
    q.products = engine::kPosition | engine::kRange;
    return q;
  }

  static Errors errors_of(const engine::FrameRequest& q, const engine::FrameProducts& p) {
    const Pinhole pinhole{q.camera, q.pose};
    Errors e;
    for (int i = 0; i < kSmallSide * kSmallSide; ++i) {
      const auto at = static_cast<std::size_t>(i);
      e.range_error_m.push_back(std::nan(""));
      const Vec3 position = at3(p.position, at);
      if (std::isnan(position.x())) continue;
      const FirstHit truth = judge().first_hit(q.pose.position_m, pinhole.ray(i));
      ++e.hits;
      e.farthest_m = std::max(e.farthest_m, p.range[at]);
      e.px = std::max(e.px, pinhole.pixels_off(i, position));
      e.off_terrain_m = std::max(e.off_terrain_m, std::abs(judge().height_above_surface(position).value_or(1e9)));
      const double error = p.range[at] - truth.distance_m;
      if (!(std::abs(error) < 15)) {  // the other side of an outline
        ++e.outlines;
        continue;
      }
      e.range_error_m.back() = error;
      e.range_m = std::max(e.range_m, std::abs(error));
    }
    return e;
  }

 private:
  static inline TemporaryFolder* folder_ = nullptr;
  static inline Judge* judge_ = nullptr;
  static inline engine::Renderer* renderer_ = nullptr;
};

std::vector<double> tile_heights_m() {
  std::vector<double> heights;
  for (double decade = 1; decade < 1e9; decade *= 10)
    for (const double h : {1.0, 2.0, 5.0})
      if (h * decade >= 2 && h * decade <= 2e8) heights.push_back(h * decade);
  heights.push_back(4e8);
  return heights;
}

TEST_F(Distances, EveryHeightIsExactToRounding) {
  fmt::print("{:>10} {:>10} {:>9} {:>9} {:>9} {:>10} | default: {:>8} {:>9} {:>10} {:>8}\n", "height m", "m/pixel",
             "pixel px", "range m", "relative", "terrain m", "pixel px", "terrain m", "promised m", "px");
  for (const double height : tile_heights_m()) {
    SCOPED_TRACE(height);
    engine::FrameRequest q = request_at(height, 20);
    const Errors e = errors_of(q, renderer().render(q).products);
    q.accuracy.max_error_px = 0.5;
    const engine::Frame coarse = renderer().render(q);
    const Errors d = errors_of(q, coarse.products);
    const double m_per_px = e.farthest_m / q.camera.fx, allowed_m = rounding_m(e.farthest_m);
    fmt::print("{:10.0f} {:10.3g} {:9.1e} {:9.1e} {:9.1e} {:10.1e} | {:17.1e} {:9.1e} {:10.1e} {:8.3f}\n", height,
               m_per_px, e.px, e.range_m, e.range_m / e.farthest_m, e.off_terrain_m, d.px, d.off_terrain_m,
               coarse.report.lod_error_m, d.off_terrain_m / m_per_px);
    EXPECT_EQ(e.hits, kSmallSide * kSmallSide) << "the view is of the tile";
    EXPECT_EQ(e.outlines, 0);
    // Across the ray, rounding is that of the position and of its difference from the camera.
    EXPECT_LT(e.px, 1e-12 * q.camera.fx + allowed_m / m_per_px);
    EXPECT_LT(e.range_m, allowed_m);
    EXPECT_LT(e.off_terrain_m, allowed_m);
    // With the default settings a position still lies on its ray; on the terrain within what the frame promises.
    EXPECT_LT(d.px, 1e-12 * q.camera.fx + allowed_m / m_per_px);
    EXPECT_LE(d.off_terrain_m, coarse.report.lod_error_m + allowed_m);
    EXPECT_LE(coarse.report.lod_error_px, 0.5);
  }
}

TEST_F(Distances, CropsAreExact) {
  // From 400 000 km a camera looks at the Moon's centre, and the image is a crop far from its boresight: down to where
  // the tile lies near the limb, up to 1700 km from the camera's foot.
  for (const double off_deg : {0.0, 30.0, 60.0, 80.0, 85.0}) {
    SCOPED_TRACE(off_deg);
    engine::FrameRequest q = request_at(4e8, 0);
    const EastNorthUp axes = local_axes(centre());
    const double off = off_deg * kDegree;
    const Vec3 up = std::cos(off) * axes.up + std::sin(off) * axes.east;
    q.pose = looking(up * 4e8, -up, axes.north);
    const Vec3 c = q.pose.camera_from_moon * (centre() - q.pose.position_m);
    q.camera.cx -= q.camera.fx * c.x() / c.z(), q.camera.cy -= q.camera.fy * c.y() / c.z();
    const Errors e = errors_of(q, renderer().render(q).products);
    fmt::print(
        "crop {:2.0f} degrees from the boresight's foot: {} points, {} at outlines, range off by {:.1e} m, {:.1e} m "
        "off the terrain\n",
        off_deg, e.hits, e.outlines, e.range_m, e.off_terrain_m);
    EXPECT_GT(e.hits, 100);
    // The flatter the view, the farther rounding carries along the ray; slopes here make it flatter still.
    EXPECT_LT(e.range_m, (off_deg < 75 ? 1 : 30) * rounding_m(4e8));
    EXPECT_LT(e.off_terrain_m, rounding_m(4e8));
    EXPECT_EQ(e.outlines, 0) << "float by the boresight's foot would blur them";
  }
}

TEST_F(Distances, HitsDoNotDependOnTheRayOrigin) {
  // Each ray is started 2 m to 400 000 km before it reaches its target; the anchor moves with the first one's start.
  const EastNorthUp axes = local_axes(centre());
  std::vector<engine::Ray> rays;
  for (int i = 0; i < 400; ++i) {
    const double east = 20 * (i % 20) - 190 + 0.37, north = 20 * (i / 20) - 190 + 0.21;
    const Vec3 over = centre() + east * axes.east + north * axes.north;
    const double tilt = 0.5 * std::sin(1.7 * i), azimuth = 2.4 * i;
    const Vec3 back =
        std::cos(tilt) * axes.up + std::sin(tilt) * (std::cos(azimuth) * axes.east + std::sin(azimuth) * axes.north);
    const Vec3 start = over + 300 * back;
    const FirstHit target = judge().first_hit(start, -back);
    ASSERT_EQ(target.hit, Verdict::yes);
    rays.push_back({start - (target.distance_m - 2) * back, -back});
  }
  const auto nearest = test::cast_rays(renderer(), rays);
  double worst = 0;
  for (const double height : tile_heights_m()) {
    std::vector<engine::Ray> from = rays;
    for (engine::Ray& r : from) r.origin_m -= (height - 2) * r.direction;
    const auto hits = test::cast_rays(renderer(), from);
    double apart = 0;
    for (std::size_t i = 0; i < hits.size(); ++i) {
      ASSERT_TRUE(hits[i].hit) << height << " m, ray " << i;
      apart = std::max(apart, (hits[i].position_m - nearest[i].position_m).norm());
      EXPECT_NEAR(hits[i].range_m, height, rounding_m(height)) << "ray " << i;
    }
    EXPECT_LT(apart, rounding_m(height)) << height;
    worst = std::max(worst, apart / rounding_m(height));
  }
  fmt::print("same rays from 2 m to 400 000 km: points apart by at most {:.2f} of the allowed rounding\n", worst);
}

// ---- where the anchor changes --------------------------------------------------------------------------------------

// Two camera positions a micrometre apart with different anchors, on the way from one place to another.
struct Border {
  Vec3 before, after;
};

Border border_between(Vec3 from, Vec3 to, const Vec3& boresight, double clearance_m) {
  const Vec3 anchor = engine::anchor_for(from, boresight, clearance_m);
  while ((to - from).norm() > 1e-6) {
    const Vec3 middle = (from + to) / 2;
    (engine::anchor_for(middle, boresight, clearance_m) == anchor ? from : to) = middle;
  }
  return {from, to};
}

TEST_F(Distances, NoJumpWhereTheAnchorChanges) {
  const EastNorthUp axes = local_axes(centre());
  struct Walk {
    const char* name;
    double height_m, tilt_deg;
    Vec3 step_m;  // to somewhere with another anchor
  };
  // At 1.2 radii the anchor leaves the camera's foot for what the camera sees, here at 40 degrees off nadir.
  const double radius = centre().norm(), cosine = std::cos(40 * kDegree), sine = std::sin(40 * kDegree);
  const double switch_m =
      (std::sqrt(1.44 * kMoonRadius_m * kMoonRadius_m - radius * radius * sine * sine) - radius * cosine) * cosine;
  const std::vector<Walk> walks{{"2 m up, eastward", 2, 20, 12000 * axes.east},
                                {"100 m up, northward", 100, 20, 12000 * axes.north},
                                {"20 km up, eastward", 20000, 20, 36000 * axes.east},
                                {"20 km up, upward", 20000, 20, 36000 * axes.north + 3000 * axes.up},
                                {"329 km up, near to far", switch_m, 40, 20 * axes.up},
                                {"1000 km up, sideways", 1e6, 30, 36000 * axes.north}};
  for (const Walk& w : walks) {
    SCOPED_TRACE(w.name);
    engine::FrameRequest q = request_at(w.height_m, w.tilt_deg);
    q.products |= engine::kLit;
    q.sun.direction = local_sun(kTileLat, kTileLon, 120, 10);
    const Vec3 boresight = q.pose.camera_from_moon.conjugate() * Vec3::unit_z();
    const Vec3 from = q.pose.position_m - w.step_m / 2;
    const double clearance_m = w.height_m / 2;  // on the same side of what the anchor's lattice asks as the frame's
    Border border = border_between(from, from + w.step_m, boresight, clearance_m);
    if (w.height_m < 10000) {  // on the way the ground has risen and fallen
      const double lift = (ground_m(border.before) + kMoonRadius_m + w.height_m) / border.before.norm();
      border.before *= lift, border.after *= lift;
    }
    const Vec3 moved_m = engine::anchor_for(border.after, boresight, clearance_m) -
                         engine::anchor_for(border.before, boresight, clearance_m);
    ASSERT_GE(moved_m.norm(), 4096);
    Errors steps[2];
    std::vector<float> lit[2];
    for (const int i : {0, 1}) {
      q.pose.position_m = i == 0 ? border.before : border.after;
      const engine::Frame frame = renderer().render(q);
      steps[i] = errors_of(q, frame.products), lit[i] = frame.products.lit;
    }
    double jump = 0;
    int changed = 0;
    for (std::size_t i = 0; i < steps[0].range_error_m.size(); ++i) {
      jump = std::max(jump, std::abs(steps[1].range_error_m[i] - steps[0].range_error_m[i]));
      changed += lit[0][i] != lit[1][i] && !(std::isnan(lit[0][i]) && std::isnan(lit[1][i]));
    }
    fmt::print("{:<24} anchor moves {:8.0f} m: range jumps by {:.1e} m, error {:.1e} m, {} of {} lit flags change\n",
               w.name, moved_m.norm(), jump, std::max(steps[0].range_m, steps[1].range_m), changed, steps[0].hits);
    EXPECT_GT(steps[0].hits, kSmallSide * kSmallSide / 2);
    EXPECT_EQ(steps[0].hits, steps[1].hits);
    EXPECT_LT(jump, 2 * rounding_m(steps[0].farthest_m));
    EXPECT_LT(changed, steps[0].hits / 500);
  }
}

}  // namespace
}  // namespace selenograph::test
