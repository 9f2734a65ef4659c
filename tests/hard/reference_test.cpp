// Frames against the double-precision judge: every point on its ray and on the terrain, every shadow where it belongs.
//
// All frames ask for the finest posts (max_error_px 0), so the engine's mesh is meant to be the judge's triangles
// exactly. Each test prints what it found; see support/judge.h for what the judge is.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "tests/support/effort.h"
#include "tests/support/frame_judge.h"
#include "tests/support/hard_views.h"
#include "tests/support/judge.h"
#include "tests/support/sample_scenery.h"
#include "tests/support/shared_data.h"
#include "tests/support/tiles.h"

namespace selenograph::test {
namespace {

const int kReferenceSide = full_effort() ? 256 : 128;  // pixels
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

TEST_F(JudgeItself, AgreesWithBruteForce) {
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
TEST_F(JudgeItself, NoRayPassesThroughEdges) {
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

TEST(JudgeOfAPlain, MatchesTheClosedForm) {
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

TEST(JudgeOfAPlain, VoidsAreUndecided) {
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

struct Look {
  const char* name;
  double lat_deg, lon_deg, height_m;
  double off_nadir_deg, azimuth_deg;  // compass azimuth of the boresight
  double fov_deg;
};

engine::FrameRequest request_for(const Look& look, double sun_elevation_deg, double sun_azimuth_deg) {
  const Vec3 position = to_cartesian({look.lat_deg, look.lon_deg, look.height_m});
  const Vec3 boresight = local_direction(position, look.azimuth_deg, look.off_nadir_deg - 90);
  const Vec3 up = look.off_nadir_deg > 0 ? position : local_direction(position, look.azimuth_deg, 0);
  return square_view(looking(position, boresight, up), kReferenceSide, look.fov_deg,
                     local_direction(position, sun_azimuth_deg, sun_elevation_deg));
}

// Off-nadir angle of the horizon of the sphere through the ground.
double horizon_deg(double height_m) { return std::asin(kMoonRadius_m / (kMoonRadius_m + height_m)) / kDegree; }

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
  EXPECT_LE(all.wrong, 10U) << "the front page says 2 of 918 219, of all views";
  EXPECT_GT(all.lit * 10, all.hits) << "both light and shadow are judged";
  EXPECT_GT((all.hits - all.lit) * 10, all.hits);
}

class SampleFrames : public SampleScenery {
 protected:
  static Look nadir() { return {"sample nadir 20 km", -10.0, 44.0, 20000, 0, 0, 50}; }
};

TEST_F(SampleFrames, AgreeWithTheReference) {
  // Low enough for the horizon to lie on the mosaic.
  const double ground = scenery().terrain->height(-10.85, 44.3).height_m;
  judge_views(scenery(), {nadir(),
                          {"sample 60 deg oblique", -10.6, 44.2, 20000, 60, 345, 30},
                          {"sample limb", -10.85, 44.3, ground + 700, horizon_deg(700), 350, 30}});
}

TEST_F(SampleFrames, ReferenceDetectsAMovedSurface) {
  const auto request = request_for(nadir(), 15, 115);
  const engine::Frame frame = scenery().renderer->render(request);
  const Findings raised = judged(Judge(folder(), 0.05), request, frame);
  EXPECT_GT(raised.off_terrain * 10, raised.hits * 9) << "5 cm are five times the tolerance";
  EXPECT_GT(raised.unexplained * 10, raised.hits * 9);
}

TEST_F(SampleFrames, ReferenceDetectsAnotherSun) {
  const engine::Frame frame = scenery().renderer->render(request_for(nadir(), 15, 115));
  const Findings turned = judged(*scenery().judge, request_for(nadir(), 15, 117), frame);
  EXPECT_GT(turned.wrong * 1000, turned.flags) << "shadows that are 2 degrees off are noticed";
  EXPECT_EQ(turned.off_terrain, 0u);
}

TEST(HadleyFrames, AgreeWithTheReference) {
  const std::string folder = shared_data("hadley");
  SELENOGRAPH_SKIP_WITHOUT(folder);
  const Scenery scenery(folder);
  judge_views(scenery, {{"hadley nadir 20 km", 26.1322, 3.6339, 20000, 0, 0, 50},
                        {"hadley 60 deg oblique", 25.0, 3.2, 20000, 60, 20, 30},
                        {"hadley limb", 18.6, 6.0, 20000, horizon_deg(20000), 0, 30}});
}

}  // namespace
}  // namespace selenograph::test
