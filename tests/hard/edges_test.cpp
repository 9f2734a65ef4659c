// Rays exactly through posts and along edges: one surface each, the nearest, the same from whichever triangle; and the
// light on points that lie exactly there. (seams_test: none of ten million is lost.)
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include "tests/support/frame_judge.h"
#include "tests/support/hard_views.h"
#include "tests/support/queries.h"
#include "tests/support/shared_data.h"
#include "tests/support/tiles.h"

namespace selenograph::test {
namespace {

using Random = std::mt19937_64;
double between(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

class Edges : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    write_kaguya_tile(folder_->path(), 31, 59, 1, 256, crags);
    scenery_ = new Scenery(folder_->path());
  }
  static void TearDownTestSuite() {
    delete scenery_;
    delete folder_;
    scenery_ = nullptr, folder_ = nullptr;
  }
  static const Judge& judge() { return *scenery_->judge; }
  static const engine::Renderer& renderer() { return *scenery_->renderer; }

  static inline TemporaryFolder* folder_ = nullptr;
  static inline Scenery* scenery_ = nullptr;
};

// A place on the lattice's lines: a post, or somewhere on one of the three edges that begin at it.
struct Target {
  Vec3 place;
  std::vector<Face> faces;  // that meet there
};

Target random_target(const Judge& judge, Random& random, int margin) {
  std::uniform_int_distribution<int> any(margin, judge.rows() - 1 - margin);
  const int r = any(random), c = any(random);
  const Face own{r, c, false};
  const FaceVertices face = *judge.vertices(own);  // a: the post, b: its east, c: its north
  const double share = between(random, 0, 1);
  switch (random() % 6) {
    case 0:
      return {face.a + share * (face.b - face.a), {own, {r - 1, c, true}}};
    case 1:
      return {face.a + share * (face.c - face.a), {own, {r, c - 1, true}}};
    case 2:  // the diagonal
      return {face.b + share * (face.c - face.b), {own, {r, c, true}}};
    default:
      return {face.a,
              {own, {r, c - 1, true}, {r, c - 1, false}, {r - 1, c, true}, {r - 1, c, false}, {r - 1, c - 1, true}}};
  }
}

// How far along a ray each of those faces has the place that it is aimed at. Empty when one of them is seen from
// behind or (nearly) along itself: then the place is on an outline, which a ray may pass by.
constexpr double kAlong = 5e-3;
std::vector<double> meetings(const Judge& judge, const Target& target, const engine::Ray& ray) {
  std::vector<double> distances;
  for (const Face& face : target.faces) {
    const FaceVertices t = *judge.vertices(face);
    const double toward = t.normal().dot(ray.direction);
    if (toward > -kAlong) return {};
    distances.push_back(t.normal().dot(t.a - ray.origin_m) / toward);
  }
  return distances;
}

TEST_F(Edges, RaysHitTheNearestSurfaceOnce) {
  Random random(1);
  std::vector<engine::Ray> rays;
  std::vector<Target> targets;
  for (int i = 0; i < 40000; ++i) {
    targets.push_back(random_target(judge(), random, 40));
    const Vec3& place = targets.back().place;
    const double far = std::pow(10.0, between(random, 1, i % 7 ? 4.5 : 8));
    const Vec3 origin = place + far * local_direction(place, between(random, 0, 360), between(random, 3, 90));
    rays.push_back({origin, (place - origin).normalized()});
  }
  const std::vector<engine::RayHit> hits = test::cast_rays(renderer(), rays);
  std::size_t aimed = 0, hidden = 0, outlines = 0, passed = 0, before = 0;
  double worst = 0, disagreement = 0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const FirstHit truth = judge().first_hit(rays[i].origin_m, rays[i].direction);
    ASSERT_EQ(truth.hit, Verdict::yes);
    if (!truth.from_above) continue;  // in from below, through the tile's rim
    const std::vector<double> met = meetings(judge(), targets[i], rays[i]);
    const bool reaches = truth.distance_m > (targets[i].place - rays[i].origin_m).norm() - 0.01;
    if (reaches ? met.empty()
                : at_outline(judge(), rays[i].origin_m, rays[i].direction, truth.distance_m, hits[i].range_m)) {
      ++outlines;
      continue;
    }
    ++(reaches ? aimed : hidden);
    const double off = hits[i].range_m - truth.distance_m;
    before += off < -1e-6;
    passed += !(off <= 1e-6);  // hits nothing, too
    if (std::abs(off) > 1e-6) continue;
    worst = std::max(worst, std::abs(off));
    if (!reaches) continue;
    for (const double distance : met) disagreement = std::max(disagreement, std::abs(distance - hits[i].range_m));
  }
  fmt::print(
      "{} rays at posts and edges: {} reach their aim, {} end before it, {} are aimed at outlines; {} pass, {} end "
      "before the judge's surface, the others within {:.1e} m; faces that meet differ by {:.1e} m at most\n",
      rays.size(), aimed, hidden, outlines, passed, before, worst, disagreement);
  EXPECT_EQ(passed + before, 0u);
  EXPECT_GT(aimed, 20000u);
  EXPECT_GT(hidden, 500u);
  // Rounding of an origin 1e8 m away, on faces seen at 5e-3 rad.
  EXPECT_LT(disagreement, 1e-6);
}

// From posts and edges toward the Sun. The faces that meet there may disagree (one of them faces away from it); then
// either answer is right. Where they agree, so must the engine.
TEST_F(Edges, ShadowsAgreeWithTheReference) {
  Random random(2);
  for (const double elevation : {2.0, 10.0, 40.0}) {
    const Vec3 sun = local_direction(to_cartesian({30.5, 59.5, 0}), 133, elevation);
    std::vector<engine::Ray> rays;
    std::vector<Target> targets;
    for (int i = 0; i < 3000; ++i) {
      targets.push_back(random_target(judge(), random, 30));
      const Vec3& place = targets.back().place;
      rays.push_back({place * (1 + 3000 / place.norm()), -place.normalized()});
    }
    const std::vector<engine::RayHit> hits = test::cast_rays(renderer(), rays, engine::Sun{sun, 1, 0});
    std::size_t lit = 0, dark = 0, either = 0, wrong = 0, grazing = 0;
    for (std::size_t i = 0; i < hits.size(); ++i) {
      ASSERT_TRUE(hits[i].hit);
      ASSERT_LT((hits[i].position_m - targets[i].place).norm(), 1e-6);
      const double mu0 = hits[i].normal.dot(sun);
      if (std::abs(mu0) < 1e-6) continue;
      std::array<bool, 2> said{};
      bool near_grazing = false;
      for (const Face& face : targets[i].faces) {
        const FaceVertices t = *judge().vertices(face);
        const bool faces_sun = mu0 > 0 && t.normal().dot(sun) > 0;
        const Verdict blocked = faces_sun ? judge().sun_blocked(hits[i].position_m, face, sun) : Verdict::yes;
        ASSERT_NE(blocked, Verdict::unknown);
        said[blocked == Verdict::no] = true;
        near_grazing |= faces_sun && judge().grazes(hits[i].position_m, face, sun, kGrazing_m);
      }
      if (said[0] && said[1]) {
        ++either;
        continue;
      }
      ++(said[1] ? lit : dark);
      if ((hits[i].lit > 0) == said[1]) continue;
      ++(near_grazing ? grazing : wrong);
    }
    fmt::print(
        "Sun at {} deg, points on posts and edges: {} lit, {} dark, {} between faces that disagree; {} wrong, {} "
        "wrong within 1 m of grazing\n",
        elevation, lit, dark, either, wrong, grazing);
    EXPECT_EQ(wrong, 0u);
    EXPECT_LE(grazing * 200, lit + dark);
    EXPECT_GT(lit, 300u);
    if (elevation < 20) {
      EXPECT_GT(dark, 300u);
    }
  }
}

}  // namespace
}  // namespace selenograph::test
