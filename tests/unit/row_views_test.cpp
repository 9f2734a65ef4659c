// Rows with times: poses in between, the views of the rows and what bounds them, where a point is seen and when.
#include "engine/camera/row_views.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>

#include "dem/base/error.h"
#include "engine/camera/packet_rays.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

using test::kDegree;
using test::looking;

constexpr double kOrbit_m = kMoonRadius_m + 50000, kSpeed_m_s = 1650;

// Of a circular orbit around the Moon's axis, straight down, image up along the way.
Pose in_orbit(double seconds) {
  const double angle = kSpeed_m_s / kOrbit_m * seconds;
  const Vec3 from = kOrbit_m * Vec3(std::cos(angle), std::sin(angle), 0), ahead(-std::sin(angle), std::cos(angle), 0);
  return looking(from, -from, -ahead);
}

double apart(const Pose& a, const Pose& b) { return a.camera_from_moon.angle_to(b.camera_from_moon); }

Shutter through(const std::vector<double>& times_s) {
  Shutter shutter;
  for (const double time_s : times_s) shutter.poses.push_back({time_s, in_orbit(time_s)});
  return shutter;
}

Shutter at_rates(double line_time_s, const Rates& rates, bool pushbroom) {
  Shutter shutter;
  shutter.line_time_s = line_time_s, shutter.rates = rates, shutter.pushbroom = pushbroom;
  return shutter;
}

TEST(PoseTrack, ConstantRates) {
  const Shutter shutter = at_rates(1, {Vec3(0, 0, 6), Vec3(10, 20, -30)}, false);
  const Pose start = in_orbit(0), later = PoseTrack(start, shutter).at(2.5);
  EXPECT_LT((later.position_m - start.position_m - Vec3(25, 50, -75)).norm(), 1e-9);
  // Turned about its boresight by 15 degrees, from +x toward +y.
  const Vec3 right_before = start.camera_from_moon.conjugate() * Vec3::unit_x(),
             right_later = later.camera_from_moon.conjugate() * Vec3::unit_x(),
             down = start.camera_from_moon.conjugate() * Vec3::unit_y();
  EXPECT_NEAR(right_later.dot(right_before), std::cos(15 * kDegree), 1e-12);
  EXPECT_NEAR(right_later.dot(down), std::sin(15 * kDegree), 1e-12);
  const Pose before = PoseTrack(start, shutter).at(-2.5);
  EXPECT_NEAR(apart(before, later), 30 * kDegree, 1e-12);
}

TEST(PoseTrack, PassesThroughItsPoses) {
  const Shutter shutter = through({-1, 0, 0.5, 3, 10});
  const PoseTrack track({}, shutter);
  for (const PoseAtTime& p : shutter.poses) {
    EXPECT_LT((track.at(p.time_s).position_m - p.pose.position_m).norm(), 1e-9);
    EXPECT_LT(apart(track.at(p.time_s), p.pose), 1e-12);
  }
}

// Poses every 10 s, on an arc whose chords are up to 19 m from it: linear interpolation would be that far off.
TEST(PoseTrack, AnOrbitFromSparsePoses) {
  const PoseTrack track({}, through({0, 10, 20, 30, 40}));
  for (double t = 0; t <= 40; t += 0.7) {
    EXPECT_LT((track.at(t).position_m - in_orbit(t).position_m).norm(), t > 10 && t < 30 ? 0.025 : 0.1) << t;
    EXPECT_LT(apart(track.at(t), in_orbit(t)), 1e-9) << t;  // a constant rate about one axis is what slerp is
  }
}

// Neither velocity nor place jumps at a pose.
TEST(PoseTrack, SmoothAtItsPoses) {
  const PoseTrack track({}, through({0, 1, 5, 7}));
  constexpr double kStep_s = 1e-4;
  for (const double t : {0.0, 1.0, 5.0, 7.0}) {
    const Vec3 before = track.at(t).position_m - track.at(t - kStep_s).position_m,
               after = track.at(t + kStep_s).position_m - track.at(t).position_m;
    EXPECT_LT((after - before).norm() / kStep_s, 1e-3 * kSpeed_m_s) << t;
    EXPECT_NEAR(before.norm() / kStep_s, kSpeed_m_s, 1) << t;
  }
}

TEST(PoseTrack, TwoPosesAreConstantRatesBeyondThemToo) {
  Shutter shutter = through({1, 3});
  Quat& second = shutter.poses[1].pose.camera_from_moon;
  second = {-second.w, -second.x, -second.y, -second.z};  // the same attitude: the shorter way is the same
  const PoseTrack track({}, shutter);
  const Vec3 way = shutter.poses[1].pose.position_m - shutter.poses[0].pose.position_m;
  const double turn = apart(shutter.poses[0].pose, shutter.poses[1].pose);
  for (const double t : {-1.0, 1.5, 2.0, 3.0, 9.0}) {
    EXPECT_LT((track.at(t).position_m - shutter.poses[0].pose.position_m - (t - 1) / 2 * way).norm(), 1e-8) << t;
    EXPECT_NEAR(apart(track.at(t), shutter.poses[0].pose), std::abs(t - 1) / 2 * turn, 1e-12) << t;
  }
}

// Cameras and how they move, from an orbit: slowly, fast, through poses; lens, fisheye.
struct RowCase {
  const char* name;
  Camera camera;
  Shutter shutter;
};

std::vector<RowCase> row_cases() {
  std::vector<RowCase> all;
  Camera camera{96, 80, 300, 310, 47.5, 39.5, {}}, lens = camera, fisheye = camera;
  lens.distortion = {-0.2, 0.05, 0, 0.001, -0.002};
  fisheye.model = CameraModel::fisheye, fisheye.fx = fisheye.fy = 30;
  // The y axis is against the way: up in the image is backwards.
  const Rates slow{Vec3(0, 0, 0.3), Vec3(0, 1600, 10)}, fast{Vec3(-5, 10, 5), Vec3(500, 2000, 300)};
  all.push_back({"slow", camera, at_rates(1e-4, slow, false)});
  all.push_back({"fast", camera, at_rates(1e-2, fast, false)});
  all.push_back({"lens", lens, at_rates(1e-3, fast, false)});
  all.push_back({"fisheye", fisheye, at_rates(1e-2, fast, false)});
  Camera strip = camera;
  strip.height = 1000, strip.cy = 499.5;
  all.push_back({"strip", strip, at_rates(0.1, {Vec3(-0.053, 0, 0), Vec3(0, 1650, 0)}, true)});
  Camera bent = lens;
  bent.height = 700, bent.cy = 10;
  all.push_back({"bent strip", bent, at_rates(0.1, {Vec3(0.02, 0.01, 0.01), Vec3(0, 1650, 0)}, true)});
  Shutter poses = through({-1, 0, 30, 60, 100});
  poses.line_time_s = 0.1, poses.pushbroom = true;
  all.push_back({"poses", strip, poses});
  return all;
}

TEST(RowViews, EachRowHasThePoseOfItsTime) {
  for (const RowCase& c : row_cases()) {
    SCOPED_TRACE(c.name);
    const RowViews views(c.camera, in_orbit(0), c.shutter);
    const PoseTrack track(in_orbit(0), c.shutter);
    ASSERT_TRUE(views.vary());
    for (const int row : {0, 1, c.camera.height / 2, c.camera.height - 1}) {
      const Pose pose = track.at(row * c.shutter.line_time_s);
      EXPECT_EQ(views.of(row).position(), pose.position_m);
      EXPECT_EQ(views.of_pixel(static_cast<std::size_t>(row * c.camera.width + 5)).position(), pose.position_m);
      EXPECT_EQ(views.line(row), c.shutter.pushbroom ? 0 : row);
    }
  }
}

TEST(RowViews, AFirstRowBeforeTheImageIsEarlier) {
  Shutter shutter = at_rates(0.5, {Vec3::zero(), Vec3(0, 100, 0)}, false);
  const Camera camera = test::square_camera(8, 40);
  const RowViews without(camera, in_orbit(0), shutter);
  shutter.first_row = -3;
  Camera higher = camera;
  higher.height += 6, higher.cy += 3;
  const RowViews with(higher, in_orbit(0), shutter);
  for (int row = 0; row < 8; ++row) EXPECT_EQ(with.of(row + 3).position(), without.of(row).position());
}

// What any row sees is within the bundles' bounds.
TEST(RowViews, BundlesBoundAllRows) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> share(0, 1);
  for (const RowCase& c : row_cases()) {
    SCOPED_TRACE(c.name);
    const RowViews views(c.camera, in_orbit(0), c.shutter);
    EXPECT_LE(views.bundles().size(), 512U);
    int seen = 0;
    for (int k = 0; k < 3000; ++k) {
      const int row = static_cast<int>(share(random) * c.camera.height);
      const View& view = views.of(row);
      const double x = -0.5 + share(random) * c.camera.width, distance = 40000 + 40000 * share(random);
      const auto ray = view.ray(x, views.line(row) - 0.5 + share(random));
      if (!ray) continue;
      ++seen;
      const Vec3 point = view.position() + distance * ray->normalized(), points[] = {point};
      const auto in_bounds = [&](const ViewBundle& bundle) {
        return bundle.may_see(point, 0) && bundle.may_see(std::span<const Vec3>(points), 0);
      };
      ASSERT_TRUE(std::any_of(views.bundles().begin(), views.bundles().end(), in_bounds)) << row;
      // A metre beside it, in pixels.
      const Vec3 aside = Vec3(share(random) - 0.5, share(random) - 0.5, share(random) - 0.5).normalized();
      const auto here = view.project(point), there = view.project(point + aside);
      if (!here || !there) continue;
      double most = 0;
      for (const ViewBundle& bundle : views.bundles())
        if (in_bounds(bundle)) most = std::max(most, bundle.pixels_per_metre(point, 1, kOrbit_m));
      ASSERT_LE(std::hypot(there->x - here->x, there->y - here->y), most);
    }
    EXPECT_GT(seen, 2000);
  }
}

// Back to the pixel from which a point was seen.
TEST(RowViews, APointIsFoundInTheRowThatSeesIt) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> share(0, 1);
  for (const RowCase& c : row_cases()) {
    SCOPED_TRACE(c.name);
    const RowViews views(c.camera, in_orbit(0), c.shutter);
    for (int k = 0; k < 1000; ++k) {
      const int row = static_cast<int>(share(random) * c.camera.height);
      const double x = -0.4 + share(random) * (c.camera.width - 0.2);
      const auto ray = views.of(row).ray(x, views.line(row));
      if (!ray) continue;
      const Vec3 from = views.of(row).position(), point = from + (50000 + 3000 * share(random)) * ray->normalized();
      const auto found = views.find(point);
      ASSERT_TRUE(found) << row;
      ASSERT_NEAR(found->pixel.x, x, 1e-5);
      ASSERT_NEAR(found->pixel.y, row, 1e-5);
      ASSERT_NEAR(found->time_s, row * c.shutter.line_time_s, 1e-5 * c.shutter.line_time_s);
      ASSERT_LT((found->camera_m - from).norm(), 0.05);
    }
    if (c.camera.model == CameraModel::fisheye) continue;
    // Ahead of all rows; behind the camera.
    EXPECT_FALSE(views.find(-3 * in_orbit(0).position_m + Vec3(0, 3e7, 0)));
    EXPECT_FALSE(views.find(1.5 * in_orbit(0).position_m));
  }
}

// Cameras that turn by as much as a row or more while a row is read: a point may be on its row several times, in the
// image and beside it, or come near its row and turn back.
std::vector<RowCase> fast_cases() {
  std::vector<RowCase> all;
  Camera camera{96, 64, 130, 130, 47.5, 31.5, {}}, lens = camera, fisheye = camera;
  lens.distortion = {-0.2, 0.05, 0, 0.001, -0.002};
  fisheye.model = CameraModel::fisheye, fisheye.fx = fisheye.fy = 60;
  const Rates roll{Vec3(0, 0, 60), Vec3::zero()}, back{Vec3(0, 0, -60), Vec3(300, 1600, 0)},
      mixed{Vec3(20, -30, 60), Vec3(0, 1600, 0)};
  for (const double line_time_s : {0.002, 0.01, 0.0125, 0.015, 0.02, 0.05}) {
    for (const Camera& of : {camera, lens, fisheye})
      for (const Rates& rates : {roll, back, mixed})
        all.push_back({"rolling", of, at_rates(line_time_s, rates, false)});
    all.push_back({"pitch", camera, at_rates(line_time_s, {Vec3(30, 0, 0), Vec3::zero()}, false)});
    all.push_back({"against the rows", camera, at_rates(line_time_s, {Vec3(-30, 0, 0), Vec3::zero()}, false)});
    all.push_back({"yaw", camera, at_rates(line_time_s, {Vec3(0, 60, 0), Vec3::zero()}, false)});
    all.push_back({"line", camera, at_rates(line_time_s, mixed, true)});
    all.push_back({"turning line", lens, at_rates(line_time_s, roll, true)});
  }
  return all;
}

TEST(RowViews, PointsSeenDuringFastTurnsAreFoundInTheImage) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> share(0, 1);
  int elsewhere = 0, all = 0;
  for (const RowCase& c : fast_cases()) {
    SCOPED_TRACE(fmt::format("{} {} s", c.name, c.shutter.line_time_s));
    const RowViews views(c.camera, in_orbit(0), c.shutter);
    const PoseTrack track(in_orbit(0), c.shutter);
    for (int row = 0; row < c.camera.height; ++row)
      for (int x = 0; x < c.camera.width; ++x) {
        // Its middle, and a place that is not on the row at the row's own time.
        const double aside_px = x % 2 == 0 ? 0 : 0.98 * (share(random) - 0.5);
        const auto ray = views.of(row).ray(x, views.line(row) + aside_px);
        if (!ray) continue;
        const Vec3 point = views.of(row).position() + (50000 + 3000 * share(random)) * ray->normalized();
        const auto found = views.find(point);
        ASSERT_TRUE(found) << x << " " << row;
        ASSERT_TRUE(found->pixel.x >= -0.5 && found->pixel.x < c.camera.width - 0.5) << found->pixel.x;
        ASSERT_TRUE(found->pixel.y >= -0.5 && found->pixel.y < c.camera.height - 0.5) << found->pixel.y;
        ASSERT_NEAR(found->time_s, found->pixel.y * c.shutter.line_time_s, 1e-12);
        // Seen there: by the row of that time, or by a row that it comes within half a row of.
        const auto seen = views.reference().at(track.at(found->time_s)).project(point);
        ASSERT_TRUE(seen);
        const double off_px = seen->y - (c.shutter.pushbroom ? 0 : found->pixel.y);
        ASSERT_NEAR(seen->x, found->pixel.x, 1e-6);
        ASSERT_LE(std::abs(off_px), found->pixel.y == std::round(found->pixel.y) ? 0.5 : 1e-6);
        if (aside_px != 0) continue;
        ASSERT_LE(std::abs(off_px), 1e-6) << "a pixel's middle is on its row";
        ++all, elsewhere += std::hypot(found->pixel.x - x, found->pixel.y - row) > 1e-4;
      }
  }
  EXPECT_LT(elsewhere, all / 4) << "that are seen by several rows";
}

// Before the first row and after the last one nothing is seen, though the line would get there.
TEST(RowViews, PointsBeyondTheStripAreNotSeen) {
  const RowCase strip = row_cases()[4];
  const RowViews views(strip.camera, in_orbit(0), strip.shutter);
  const auto below = [&](double row) {
    const Pose pose = PoseTrack(in_orbit(0), strip.shutter).at(row * strip.shutter.line_time_s);
    return Vec3(pose.position_m + pose.camera_from_moon.conjugate() * Vec3(0, 0, 50000));
  };
  EXPECT_TRUE(views.find(below(-0.4)));
  EXPECT_FALSE(views.find(below(-0.6)));
  EXPECT_TRUE(views.find(below(999.4)));
  EXPECT_FALSE(views.find(below(999.6)));
  EXPECT_FALSE(views.find(below(-200)));
}

}  // namespace
}  // namespace selenograph::engine
