// Frames against the double-precision judge: every point on its ray and on the terrain, every shadow where it belongs.
//
// All frames ask for the finest posts (max_error_px 0), so the engine's mesh is meant to be the judge's triangles
// exactly. Each test prints what it found; see support/judge.h for what the judge is.
#include "tests/support/judge.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "dem/sample_terrain.h"
#include "dem/terrain.h"
#include "engine/renderer.h"
#include "tests/support/shared_data.h"
#include "tests/support/tiles.h"

namespace selenograph::test {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kSide = 256;  // pixels
constexpr double kTolerance_m = 0.01;
constexpr double kGrazing_m = 1.0;
constexpr double kSunElevations_deg[] = {3, 15, 45};

// ---- the judge itself ----------------------------------------------------------------------------------------------

double rough(double lat_deg, double lon_deg) {
  const double crags =
      300 * std::sin(97 * lat_deg) * std::cos(83 * lon_deg) + 150 * std::sin(401 * lat_deg + 307 * lon_deg);
  return 1000 + crags + 40 * std::sin(1709 * lat_deg) * std::sin(1511 * lon_deg);
}

Vec3 toward(const Vec3& from, const Vec3& to) { return (to - from).normalized(); }

class JudgeItself : public ::testing::Test {
 protected:
  JudgeItself() { write_kaguya_tile(folder_.path(), 62, -1, 2, 24, rough); }

  // From all around to somewhere in the patch, a good part of them along the surface.
  std::pair<Vec3, Vec3> random_ray() {
    std::uniform_real_distribution<double> place(0.05, 1.9), height(-200, 2500), far(-3, 3);
    const Vec3 target = to_cartesian({60 + place(random_), -1 + place(random_), height(random_)});
    const Vec3 origin = to_cartesian({61 + far(random_), far(random_), 1500 + 20000 * std::pow(place(random_) / 2, 4)});
    return {origin, toward(origin, target)};
  }

  TemporaryFolder folder_;
  std::mt19937_64 random_{1};
};

TEST_F(JudgeItself, MarchesToWhatBruteForceFinds) {
  const Judge judge(folder_.path());
  int hits = 0;
  for (int i = 0; i < 3000; ++i) {
    const auto [origin, direction] = random_ray();
    const FirstHit marched = judge.first_hit(origin, direction),
                   brute = judge.first_hit_by_brute_force(origin, direction);
    ASSERT_EQ(marched.hit, brute.hit) << "ray " << i;
    if (marched.hit == Verdict::no) continue;
    ++hits;
    ASSERT_NEAR(marched.distance_m, brute.distance_m, 1e-6) << "ray " << i;
    ASSERT_EQ(marched.from_above, brute.from_above) << "ray " << i;
  }
  EXPECT_GT(hits, 1500);
}

// A ray aimed at a post or an edge must not slip between the triangles that meet there.
TEST_F(JudgeItself, LetsNoRayThroughEdges) {
  const Judge judge(folder_.path());
  std::uniform_int_distribution<int> quad(8, judge.columns() - 10);
  std::uniform_real_distribution<double> along(0, 1), aside(-0.5, 0.5);
  for (int i = 0; i < 20000; ++i) {
    const auto face = judge.vertices({quad(random_), quad(random_), i % 2 == 0});
    const double share = i % 4 < 2 ? 0 : along(random_);
    const Vec3 target = face->a + share * (i % 8 < 4 ? face->b - face->a : face->c - face->a);
    const Vec3 up = target.normalized();
    const Vec3 origin =
        target + 3000 * (up + aside(random_) * local_axes(up).east + aside(random_) * local_axes(up).north);
    const FirstHit hit = judge.first_hit(origin, toward(origin, target));
    ASSERT_EQ(hit.hit, Verdict::yes) << "ray " << i;
    ASSERT_LT(hit.distance_m, (target - origin).norm() + 1e-3) << "ray " << i;
  }
}

TEST(JudgeOfAPlain, HasTheSphereAndItsShadows) {
  TemporaryFolder folder;
  // A plain with one wall of 500 m along a meridian: its shadow under a Sun in the east ends where trigonometry says.
  write_kaguya_tile(folder.path(), 1, 0, 1, 512, [](double, double lon) { return lon == 0.75 ? 500 : 0; });
  const Judge judge(folder.path());
  const Vec3 wall = to_cartesian({0.5, 0.75, 0});
  const EastNorthUp axes = local_axes(wall);
  const double elevation = 10 * kDegree;
  const Vec3 sun = (std::sin(elevation) * axes.up + std::cos(elevation) * axes.east).normalized();
  const double length_m = 500 / std::tan(elevation);
  for (const double beyond_m : {-40.0, -5.0, 5.0, 40.0}) {
    const Vec3 above = wall - (length_m + beyond_m) * axes.east + 5000 * axes.up;
    const FirstHit ground = judge.first_hit(above, -above.normalized());
    ASSERT_EQ(ground.hit, Verdict::yes);
    const Vec3 point = above - ground.distance_m * above.normalized();
    EXPECT_NEAR(point.norm(), kMoonRadius_m, 0.01) << "chords of 59 m sag by 0.3 mm";
    // The sphere falls away by length^2 / 2 R = 2.3 m over the shadow, which so ends 13 m later.
    const double fall_m = length_m * length_m / (2 * kMoonRadius_m), later_m = fall_m / std::tan(elevation);
    EXPECT_EQ(judge.sun_blocked(point, ground.face, sun), beyond_m < later_m ? Verdict::yes : Verdict::no) << beyond_m;
    EXPECT_EQ(judge.grazes(point, ground.face, sun, kGrazing_m),
              std::abs(beyond_m - later_m) < kGrazing_m / std::tan(elevation))
        << beyond_m;
  }
}

TEST(JudgeOfAPlain, DoesNotKnowVoids) {
  TemporaryFolder folder;
  write_kaguya_tile(
      folder.path(), 1, 0, 1, 64, [](double, double) { return 0; },
      [](double lat, double lon) { return std::hypot(lat - 0.5, lon - 0.5) < 0.05; });
  const Judge judge(folder.path());
  const auto look_down = [&](double lat, double lon) {
    const Vec3 from = to_cartesian({lat, lon, 1000});
    return judge.first_hit(from, -from.normalized()).hit;
  };
  EXPECT_EQ(look_down(0.5, 0.5), Verdict::unknown);
  EXPECT_EQ(look_down(0.3, 0.5), Verdict::yes);
  EXPECT_EQ(look_down(1.3, 0.5), Verdict::no);
}

// ---- frames against the judge --------------------------------------------------------------------------------------

struct Scenery {
  std::unique_ptr<Judge> judge;
  std::shared_ptr<dem::Terrain> terrain;
  std::unique_ptr<engine::Renderer> renderer;

  explicit Scenery(const std::string& folder)
      : judge(std::make_unique<Judge>(folder)),
        terrain(
            std::make_shared<dem::Terrain>(dem::Catalogue(std::vector<std::string>{folder}), dem::TerrainOptions{})),
        renderer(std::make_unique<engine::Renderer>(terrain, engine::RendererOptions{})) {}
};

struct Look {
  const char* name;
  double lat_deg, lon_deg, height_m;
  double off_nadir_deg, azimuth_deg;  // compass azimuth of the boresight
  double fov_deg;
};

engine::FrameRequest request_for(const Look& look, double sun_elevation_deg, double sun_azimuth_deg) {
  engine::FrameRequest q;
  q.camera.width = q.camera.height = kSide;
  q.camera.fx = q.camera.fy = kSide / 2.0 / std::tan(look.fov_deg / 2 * kDegree);
  q.camera.cx = q.camera.cy = (kSide - 1) / 2.0;
  const Vec3 position = to_cartesian({look.lat_deg, look.lon_deg, look.height_m});
  const EastNorthUp axes = local_axes(position);
  const auto compass = [&](double azimuth_deg) -> Vec3 {
    return std::cos(azimuth_deg * kDegree) * axes.north + std::sin(azimuth_deg * kDegree) * axes.east;
  };
  const Vec3 ahead = compass(look.azimuth_deg);
  const double tilt = look.off_nadir_deg * kDegree;
  const Vec3 z = std::sin(tilt) * ahead - std::cos(tilt) * axes.up, x = ahead.cross(axes.up);
  Eigen::Matrix3d camera_from_moon;
  camera_from_moon << x.transpose(), z.cross(x).transpose(), z.transpose();
  q.pose = {position, Eigen::Quaterniond(camera_from_moon)};
  const double elevation = sun_elevation_deg * kDegree;
  q.sun.direction = (std::sin(elevation) * axes.up + std::cos(elevation) * compass(sun_azimuth_deg)).normalized();
  q.accuracy.max_error_px = 0;
  q.products = engine::kDepth | engine::kPosition | engine::kNormal | engine::kLit;
  return q;
}

// Off-nadir angle of the horizon of the sphere through the ground.
double horizon_deg(double height_m) { return std::asin(kMoonRadius_m / (kMoonRadius_m + height_m)) / kDegree; }

struct Findings {
  std::uint64_t pixels = 0, hits = 0, unknown = 0;
  std::uint64_t off_ray = 0, off_terrain = 0;   // more than the tolerance
  std::uint64_t outlines = 0, unexplained = 0;  // another first hit: beyond an outline that float blurs; or not
  std::uint64_t lit = 0, flags = 0, grazing = 0, wrong = 0, wrong_grazing = 0;
  double off_ray_m = 0, off_terrain_m = 0, depth_m = 0;  // the largest
  void add(const Findings& o) {
    pixels += o.pixels, hits += o.hits, unknown += o.unknown, off_ray += o.off_ray, off_terrain += o.off_terrain;
    outlines += o.outlines, unexplained += o.unexplained, flags += o.flags, grazing += o.grazing, wrong += o.wrong;
    wrong_grazing += o.wrong_grazing, lit += o.lit;
    off_ray_m = std::max(off_ray_m, o.off_ray_m), off_terrain_m = std::max(off_terrain_m, o.off_terrain_m),
    depth_m = std::max(depth_m, o.depth_m);
  }
};

// One frame, pixel by pixel.
class Trial {
 public:
  Trial(const Judge& judge, const engine::FrameRequest& request, const engine::Frame& frame)
      : judge_(judge),
        request_(request),
        products_(frame.products),
        moon_from_camera_(request.pose.camera_from_moon.conjugate().toRotationMatrix()) {}

  Findings hear() const {
    return tbb::parallel_reduce(
        tbb::blocked_range<int>(0, kSide * kSide, 64), Findings{},
        [&](const tbb::blocked_range<int>& range, Findings found) {
          for (int i = range.begin(); i < range.end(); ++i) judge_pixel(i, found);
          return found;
        },
        [](Findings a, const Findings& b) {
          a.add(b);
          return a;
        });
  }

 private:
  // Scaled so that its length along the boresight is 1, as in the contract of `depth`.
  Vec3 ray(int pixel) const {
    const engine::Camera& c = request_.camera;
    return moon_from_camera_ * Vec3((pixel % kSide - c.cx) / c.fx, (pixel / kSide - c.cy) / c.fy, 1);
  }

  void judge_pixel(int pixel, Findings& found) const {
    ++found.pixels;
    const auto at = static_cast<std::size_t>(pixel);
    const Vec3 along = ray(pixel), direction = along.normalized(), &eye = request_.pose.position_m;
    FirstHit truth = judge_.first_hit(eye, direction);
    if (truth.hit == Verdict::unknown) {
      ++found.unknown;
      return;
    }
    if (truth.hit == Verdict::yes && !truth.from_above)
      truth = {};  // through the mosaic's rim: the engine has no surface there
    const double depth = products_.depth[at], distance = depth * along.norm();
    const bool hit = !std::isnan(depth);
    if (hit) judge_position(at, direction, distance, found);
    if (hit != (truth.hit == Verdict::yes) || (hit && std::abs(truth.distance_m - distance) > kTolerance_m)) {
      ++(at_outline(eye, direction, truth.distance_m, distance) ? found.outlines : found.unexplained);
      return;
    }
    if (!hit) return;
    found.depth_m = std::max(found.depth_m, std::abs(truth.distance_m - distance));
    judge_light(at, eye + truth.distance_m * direction, truth.face, found);
  }

  void judge_position(std::size_t at, const Vec3& direction, double distance, Findings& found) const {
    ++found.hits;
    const Vec3 position(products_.position[3 * at], products_.position[3 * at + 1], products_.position[3 * at + 2]);
    const double off_ray = (position - request_.pose.position_m - distance * direction).norm();
    found.off_ray_m = std::max(found.off_ray_m, off_ray);
    found.off_ray += off_ray > kTolerance_m;
    const auto height = judge_.height_above_surface(position);
    if (!height) {
      ++found.unknown;
      return;
    }
    found.off_terrain_m = std::max(found.off_terrain_m, std::abs(*height));
    found.off_terrain += std::abs(*height) > kTolerance_m;
  }

  // Whether judge and engine see two sides of an outline: of the rays that pass the nearer point 2 cm above and below,
  // one meets the surface (about) where the engine did, and the other one far from there.
  bool at_outline(const Vec3& eye, const Vec3& direction, double truth_m, double engine_m) const {
    const double engine = std::isnan(engine_m) ? std::numeric_limits<double>::infinity() : engine_m;
    constexpr double kSame_m = 10, kOther_m = 15;
    if (!(std::abs(truth_m - engine) > kOther_m)) return false;
    const Vec3 near = eye + std::min(truth_m, engine) * direction;
    for (const double offset_m : {0.02, -0.02}) {
      const FirstHit beside = judge_.first_hit(eye, toward(eye, near + offset_m * near.normalized()));
      const double seen =
          beside.hit == Verdict::yes && beside.from_above ? beside.distance_m : std::numeric_limits<double>::infinity();
      if (seen == engine || std::abs(seen - engine) < kSame_m) return true;
    }
    return false;
  }

  void judge_light(std::size_t at, const Vec3& point, const Face& face, Findings& found) const {
    const Vec3& sun = request_.sun.direction;
    const Vec3 shading(products_.normal[3 * at], products_.normal[3 * at + 1], products_.normal[3 * at + 2]);
    const double mu0 = shading.dot(sun);
    if (std::abs(mu0) < 1e-6) return;  // the sign is beyond the float of `normal`
    const bool faces_sun = mu0 > 0 && judge_.vertices(face)->normal().dot(sun) > 0;
    const Verdict blocked = faces_sun ? judge_.sun_blocked(point, face, sun) : Verdict::yes;
    if (blocked == Verdict::unknown) {
      ++found.unknown;
      return;
    }
    const bool wrong = (products_.lit[at] != 0) != (blocked == Verdict::no);
    const bool grazing = faces_sun && judge_.grazes(point, face, sun, kGrazing_m);
    ++(grazing ? found.grazing : found.flags);
    found.lit += blocked == Verdict::no;
    if (wrong) ++(grazing ? found.wrong_grazing : found.wrong);
  }

  const Judge& judge_;
  const engine::FrameRequest& request_;
  const engine::FrameProducts& products_;
  Eigen::Matrix3d moon_from_camera_;
};

Findings judged(const Judge& judge, const engine::FrameRequest& request, const engine::Frame& frame) {
  return Trial(judge, request, frame).hear();
}

void report(const std::string& name, const Findings& f) {
  fmt::print(
      "{:<33} hits {:5}  off ray {:.1e} m  off terrain {:.1e} m  depth {:.1e} m  outlines {} unexplained {} unknown "
      "{}\n",
      name, f.hits, f.off_ray_m, f.off_terrain_m, f.depth_m, f.outlines, f.unexplained, f.unknown);
  fmt::print("{:<33} lit {:5}  flags {:5} wrong {}  within 1 m of grazing {:4} wrong {}\n", "", f.lit, f.flags, f.wrong,
             f.grazing, f.wrong_grazing);
}

void expect_agreement(const Findings& f, double least_hit_share) {
  EXPECT_GT(static_cast<double>(f.hits), least_hit_share * static_cast<double>(f.pixels))
      << "the view is not of the terrain";
  EXPECT_EQ(f.off_ray, 0u);
  EXPECT_EQ(f.off_terrain, 0u);
  EXPECT_EQ(f.unexplained, 0u);
  EXPECT_LT(f.outlines * 1000, f.pixels);
  EXPECT_LT(f.unknown * 20, f.pixels);
  EXPECT_GT(f.flags * 2, f.hits) << "most pixels are judged";
  EXPECT_LT(f.wrong * 1000, f.flags);
}

void judge_views(const Scenery& scenery, const std::vector<Look>& looks) {
  Findings all;
  for (const Look& look : looks)
    for (const double elevation : kSunElevations_deg) {
      const std::string name = fmt::format("{}, Sun {} deg", look.name, elevation);
      SCOPED_TRACE(name);
      const auto request = request_for(look, elevation, 115);
      const engine::Frame frame = scenery.renderer->render(request);
      const Findings found = judged(*scenery.judge, request, frame);
      report(name, found);
      expect_agreement(found, 0.3);
      all.add(found);
    }
  EXPECT_GT(all.lit * 10, all.hits) << "both light and shadow are judged";
  EXPECT_GT((all.hits - all.lit) * 10, all.hits);
}

// 2 x 2 tiles at 30 m posts, made once.
class SampleFrames : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    dem::SampleOptions options;
    options.south_deg = -11, options.west_deg = 43, options.rows = 2, options.columns = 2;
    options.posts_per_degree = 1024;
    dem::write_sample_terrain(folder_->path(), options);
    scenery_ = new Scenery(folder_->path());
  }
  static void TearDownTestSuite() {
    delete scenery_;
    delete folder_;
    scenery_ = nullptr, folder_ = nullptr;
  }
  static std::string folder() { return folder_->path(); }
  static const Scenery& scenery() { return *scenery_; }
  static Look nadir() { return {"sample nadir 20 km", -10.0, 44.0, 20000, 0, 0, 50}; }

 private:
  static inline TemporaryFolder* folder_ = nullptr;
  static inline Scenery* scenery_ = nullptr;
};

TEST_F(SampleFrames, AgreeWithTheJudge) {
  // Low enough for the horizon to lie on the mosaic.
  const double ground = scenery().terrain->height(-10.85, 44.3).height_m;
  judge_views(scenery(), {nadir(),
                          {"sample 60 deg oblique", -10.6, 44.2, 20000, 60, 345, 30},
                          {"sample limb", -10.85, 44.3, ground + 700, horizon_deg(700), 350, 30}});
}

TEST_F(SampleFrames, AreFoundWrongWhenTheSurfaceIsMoved) {
  const auto request = request_for(nadir(), 15, 115);
  const engine::Frame frame = scenery().renderer->render(request);
  const Findings raised = judged(Judge(folder(), 0.05), request, frame);
  EXPECT_GT(raised.off_terrain * 10, raised.hits * 9) << "5 cm are five times the tolerance";
  EXPECT_GT(raised.unexplained * 10, raised.hits * 9);
}

TEST_F(SampleFrames, AreFoundWrongUnderAnotherSun) {
  const engine::Frame frame = scenery().renderer->render(request_for(nadir(), 15, 115));
  const Findings turned = judged(*scenery().judge, request_for(nadir(), 15, 117), frame);
  EXPECT_GT(turned.wrong * 1000, turned.flags) << "shadows that are 2 degrees off are noticed";
  EXPECT_EQ(turned.off_terrain, 0u);
}

TEST(HadleyFrames, AgreeWithTheJudge) {
  const std::string folder = shared_data("hadley");
  SELENOGRAPH_SKIP_WITHOUT(folder);
  const Scenery scenery(folder);
  judge_views(scenery, {{"hadley nadir 20 km", 26.1322, 3.6339, 20000, 0, 0, 50},
                        {"hadley 60 deg oblique", 25.0, 3.2, 20000, 60, 20, 30},
                        {"hadley limb", 18.6, 6.0, 20000, horizon_deg(20000), 0, 30}});
}

}  // namespace
}  // namespace selenograph::test
