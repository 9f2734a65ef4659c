// The Sun's disc in closed form: behind a straight edge of terrain or of an object, over level ground at sunset; and
// against a thousand rays in double over real relief. By z-buffer and by rays.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <mutex>
#include <numbers>
#include <optional>
#include <random>
#include <thread>
#include <vector>

#include "engine/radiometry/photometry.h"
#include "engine/renderer.h"
#include "engine/verify/accuracy_scenes.h"
#include "engine/visibility/objects/object_mesh.h"
#include "tests/support/effort.h"
#include "tests/support/float_tiles.h"
#include "tests/support/hard_views.h"
#include "tests/support/sample_scenery.h"
#include "tests/support/shared_data.h"

namespace selenograph::test {
namespace {

// Of a disc whose centre lies h radii above a straight edge. With brightness 1 - u (1 - mu) what a chord at height y
// holds is (1 - u) 2 sqrt(1 - y^2) + u pi / 2 (1 - y^2), integrated from -h to 1 and over all of pi (1 - u / 3).
double share_above(double h, double u) {
  if (std::abs(h) >= 1) return h > 0 ? 1 : 0;
  const double even = std::numbers::pi - (std::acos(h) - h * std::sqrt(1 - h * h)),
               dome = std::numbers::pi / 2 * (2.0 / 3 + h - h * h * h / 3);
  return ((1 - u) * even + u * dome) / (std::numbers::pi * (1 - u / 3));
}

// Irradiance of a plane over that at normal incidence, its disc's centre at an elevation: (2 / 3 pi) of the radius at
// 0.
double mean_cosine(double elevation, double radius) {
  const double h = -elevation / radius;
  if (std::abs(h) >= 1) return h > 0 ? 0 : std::sin(elevation);
  return elevation * share_above(-h, 0) + radius * 2 / (3 * std::numbers::pi) * std::pow(1 - h * h, 1.5);
}

struct Off {
  double sum = 0, worst = 0;
  std::size_t count = 0;
  void add(double error) { sum += error, worst = std::max(worst, error), ++count; }
  double mean() const { return sum / static_cast<double>(count); }
};

constexpr std::pair<engine::Visibility, const char*> kWays[] = {{engine::Visibility::zbuffer, "z-buffer"},
                                                                {engine::Visibility::raytrace, "rays"}};

// A plateau 3 km high that ends along the meridian of 30 degrees, level ground east of it, the Sun in the west.
TEST(Penumbra, FramesBehindAStraightEdgeFollowTheClosedForm) {
  constexpr double kHeight_m = 3000, kElevation_deg = 20;
  TemporaryFolder folder;
  write_float_tile(folder.path(), "edge", {0.5, 29.5, 256, 257, 257},
                   [](double, double lon) { return lon <= 30 + 1e-9 ? kHeight_m : 0.0; });
  const engine::Renderer renderer(open_terrain(folder.path()), engine::RendererOptions{});
  for (const auto& [radius_deg, darkening] : {std::pair{0.2666, 0.0}, {1.0, 0.0}, {0.2666, 0.6}, {1.0, 1.0}}) {
    const double shadow_deg = kHeight_m / std::tan(kElevation_deg * kDegree) / kMoonRadius_m / kDegree;
    const Geographic middle{0.01, 30 + shadow_deg, 0};
    engine::FrameRequest request = nadir_view({middle.lat_deg, middle.lon_deg, 6000}, 256, 12,
                                              local_direction(to_cartesian(middle), 270, kElevation_deg));
    request.sun.angular_radius_deg = radius_deg, request.sun.limb_darkening = darkening;
    for (const auto& [way, name] : kWays) {
      request.visibility = way;
      const engine::FrameProducts p = renderer.render(request).products;
      Off off;
      for (std::size_t i = 0; i < p.lit.size(); ++i) {
        const Vec3 point(p.position[3 * i], p.position[3 * i + 1], p.position[3 * i + 2]);
        const Vec3 edge = to_cartesian({to_geographic(point).lat_deg, 30, kHeight_m}), to_edge = edge - point;
        // The plane of eye and edge; the Sun's distance from it.
        Vec3 normal = to_edge.cross(local_axes(edge).north).normalized();
        if (normal.dot(point) < 0) normal = -normal;
        const double above = std::asin(normal.dot(request.sun.direction)) / (radius_deg * kDegree);
        const double error = std::abs(static_cast<double>(p.lit[i]) - share_above(above, darkening));
        if (std::abs(above) < 1)
          off.add(error);
        else
          off.worst = std::max(off.worst, error);
      }
      fmt::print(
          "{}: radius {} degrees, limb darkening {}: {} pixels in the penumbra, off by {:.4f} of the disc on average, "
          "{:.4f} at worst\n",
          name, radius_deg, darkening, off.count, off.mean(), off.worst);
      EXPECT_GT(off.count, 5000U);
      EXPECT_LT(off.mean(), way == engine::Visibility::zbuffer ? 0.002 : 0.005);
      EXPECT_LT(off.worst, way == engine::Visibility::zbuffer ? 0.015 : 0.02);
    }
  }
}

TEST(Penumbra, LevelGroundAtSunsetReceivesTheClosedForm) {
  TemporaryFolder folder;
  write_float_tile(folder.path(), "plain", {0.0625, 30, 4096, 257, 257}, [](double, double) { return 0.0; });
  const engine::Renderer renderer(open_terrain(folder.path()), engine::RendererOptions{});
  const Geographic middle{0.03125, 30.03125, 1000};
  const double radius = 0.2666 * kDegree, rho = 0.12;
  for (const double elevation : {1.0, 0.26, 0.2, 0.1, 0.05, 0.0, -0.1, -0.2}) {
    // By default the Sun up, touching the horizon at both ends, and halved by it.
    if ((elevation == 0.26 || elevation == 0.1 || elevation == 0.05 || elevation == -0.1) && !full_effort()) continue;
    engine::FrameRequest request =
        nadir_view(middle, 64, 30, local_direction(to_cartesian({middle.lat_deg, middle.lon_deg, 0}), 60, elevation));
    request.sun.angular_radius_deg = 0.2666;
    request.reflectance = {.lommel_seeliger_weight = 0, .rho = rho};
    request.products = engine::kRadiance | engine::kNormal | engine::kLit;
    for (const auto& [way, name] : kWays) {
      request.visibility = way;
      const engine::FrameProducts p = renderer.render(request).products;
      Off off, share;
      for (std::size_t i = 0; i < p.lit.size(); ++i) {
        const Vec3 normal = Vec3(static_cast<double>(p.normal[3 * i]), static_cast<double>(p.normal[3 * i + 1]),
                                 static_cast<double>(p.normal[3 * i + 2]));
        const double up = std::asin(normal.dot(request.sun.direction));
        const double truth = engine::kSolarConstant_w_m2 * rho / std::numbers::pi * mean_cosine(up, radius);
        off.add(std::abs(static_cast<double>(p.radiance[i]) / truth - 1));
        share.add(std::abs(static_cast<double>(p.lit[i]) - share_above(up / radius, 0)));
      }
      fmt::print("{}: Sun's centre at {:5.2f} degrees: radiance off by {:.5f} at worst, lit by {:.5f}\n", name,
                 elevation, off.worst, share.worst);
      EXPECT_LT(off.worst, elevation < -0.15 ? 0.02 : 0.005) << name << elevation;
      // A ray along the ground may take the next facet for an obstacle: one of 256, two at most.
      EXPECT_LT(share.worst, way == engine::Visibility::zbuffer ? 0.002 : 0.009);
    }
  }
}

// A plate of 600 m that hangs 400 m over level ground, turned so and so: its edges are straight, upright in the sky or
// not. Terrain knows horizons; of objects 256 directions are asked for.
TEST(Penumbra, UnderThePlatesEdgeFollowsTheClosedForm) {
  TemporaryFolder folder;
  write_float_tile(folder.path(), "plain", {0.25, 29.75, 1024, 513, 513}, [](double, double) { return 0.0; });
  const engine::Renderer renderer(open_terrain(folder.path()), engine::RendererOptions{});
  constexpr double kHalf_m = 300, kHeight_m = 400, kRadius = 0.2666 * kDegree;
  engine::ObjectShape shape;
  for (const auto& [x, y] : {std::pair{-1, -1}, {1, -1}, {1, 1}, {-1, 1}})
    shape.corners.push_back({{static_cast<float>(x * kHalf_m), static_cast<float>(y * kHalf_m), 0.F}, {0, 0, 0}});
  shape.triangles = {{{0, 1, 2}, 0}, {{0, 2, 3}, 0}};
  shape.parts = {"plate"};
  const auto mesh = std::make_shared<const engine::ObjectMesh>(shape);
  const Vec3 middle = to_cartesian({0, 30, kHeight_m});
  const EastNorthUp axes = local_axes(middle);
  for (const double turn_deg : {0.0, 27.0, 45.0}) {
    const double turn = turn_deg * kDegree;
    const Vec3 x = std::cos(turn) * axes.east + std::sin(turn) * axes.north, y = axes.up.cross(x);
    const Mat3 m(x, y, axes.up);
    // Where the shadow falls.
    const Vec3 sun = local_direction(middle, 250, 35);
    const Geographic below = to_geographic(middle - kHeight_m / std::sin(35 * kDegree) * sun);
    engine::FrameRequest request = nadir_view({below.lat_deg, below.lon_deg, 300}, 256, 110, sun);
    request.sun.angular_radius_deg = 0.2666;
    request.objects = {{mesh, middle, Quat(m), 1, {engine::Material()}}};
    for (const auto& [way, name] : kWays) {
      request.visibility = way;
      const engine::FrameProducts p = renderer.render(request).products;
      Off off;
      for (std::size_t i = 0; i < p.lit.size(); ++i) {
        const Vec3 point = at3(p.position, i);
        for (int edge = 0; edge < 4; ++edge) {
          const Vec3 out = edge == 0 ? x : edge == 1 ? y : edge == 2 ? Vec3(-x) : Vec3(-y), along = axes.up.cross(out);
          const Vec3 on_edge = middle + kHalf_m * out, to_edge = on_edge - point;
          // Where the Sun's ray passes the plate's plane; away from its corners, where another edge counts, too.
          const Vec3 pierced = point + sun * (middle - point).dot(axes.up) / sun.dot(axes.up) - middle;
          if (std::abs(pierced.dot(along)) > 0.9 * kHalf_m || std::abs(pierced.dot(out) - kHalf_m) > 20) continue;
          Vec3 outward = to_edge.cross(along).normalized();
          if (outward.dot(out) < 0) outward = -outward;
          const double above = std::asin(outward.dot(sun)) / kRadius;
          const double error = std::abs(static_cast<double>(p.lit[i]) - share_above(above, 0));
          if (std::abs(above) < 1)
            off.add(error);
          else
            off.worst = std::max(off.worst, error);
        }
      }
      fmt::print("{}: plate turned by {} degrees: {} pixels, off by {:.4f} on average, {:.4f} at worst\n", name,
                 turn_deg, off.count, off.mean(), off.worst);
      EXPECT_GT(off.count, 300U);
      EXPECT_LT(off.mean(), 0.005);
      EXPECT_LT(off.worst, 0.02);
    }
  }
}

// Real relief: the judge sends a thousand rays toward the disc from the point that a pixel sees.
class PenumbraOverRelief : public SampleScenery {};

struct Seen {
  double lat_deg, lon_deg, height_m, tilt_deg, fov_deg;
};

constexpr std::size_t kRays = 1024;

struct PenumbraFindings {
  Off zbuffer, rays;
  std::vector<double> errors;
  std::size_t far_off = 0, others_off = 0, others = 0, undecided = 0;
};

// One view under one Sun, by both algorithms.
class PenumbraView {
 public:
  PenumbraView(const Scenery& scenery, const Seen& seen, double elevation)
      : judge_(*scenery.judge), tilt_deg_(seen.tilt_deg), elevation_(elevation) {
    const int side = full_effort() ? 384 : 224;
    const Vec3 from = to_cartesian({seen.lat_deg, seen.lon_deg, seen.height_m});
    request_ = square_view(engine::tilted_pose(from, seen.tilt_deg), side, seen.fov_deg,
                           engine::sun_direction(local_axes(from), 115, elevation));
    request_.sun.angular_radius_deg = 0.2666;
    request_.products = engine::kPosition | engine::kNormal | engine::kLit;
    request_.visibility = engine::Visibility::zbuffer;
    drawn_ = scenery.renderer->render(request_).products;
    request_.visibility = engine::Visibility::raytrace;
    traced_ = scenery.renderer->render(request_).products;
  }

  // At most so many pixels in the penumbra, and a quarter as many others.
  void judge(std::size_t most, PenumbraFindings& out) const {
    const auto in_part = [](float lit) { return lit > 0 && lit < 1; };
    std::vector<std::size_t> partly, rest;
    for (std::size_t i = 0; i < drawn_.lit.size(); ++i) {
      if (std::isnan(drawn_.lit[i]) || std::isnan(traced_.lit[i])) continue;
      // What of the disc the interpolated normal does not face is no light, and the judge knows nothing of it.
      if (at3(drawn_.normal, i).dot(request_.sun.direction) < std::sin(0.2666 * kDegree)) continue;
      const bool some = in_part(drawn_.lit[i]) || in_part(traced_.lit[i]) || drawn_.lit[i] != traced_.lit[i];
      (some ? partly : rest).push_back(i);
    }
    fmt::print("Sun {} deg, tilt {} deg: {} pixels in part\n", elevation_, tilt_deg_, partly.size());
    std::mt19937 random(7);
    std::shuffle(partly.begin(), partly.end(), random), std::shuffle(rest.begin(), rest.end(), random);
    partly.resize(std::min(partly.size(), most)), rest.resize(std::min(rest.size(), most / 4));
    judge_all(partly, true, out), judge_all(rest, false, out);
  }

 private:
  void judge_all(const std::vector<std::size_t>& pixels, bool in_penumbra, PenumbraFindings& out) const {
    std::atomic<std::size_t> next{0};
    std::mutex mutex;
    const auto work = [&] {
      for (std::size_t k = next++; k < pixels.size(); k = next++) {
        const std::optional<double> share = share_of(pixels[k]);
        const std::lock_guard lock(mutex);
        if (share) add(pixels[k], *share, in_penumbra, out);
      }
    };
    std::thread second(work);
    work(), second.join();
  }

  // Empty where the judge isn't sure that the pixel sees the ground; NaN where it isn't sure of the share.
  std::optional<double> share_of(std::size_t pixel) const {
    const Vec3 eye = request_.pose.position_m, direction = (at3(drawn_.position, pixel) - eye).normalized();
    const FirstHit truth = judge_.first_hit(eye, direction);
    if (truth.hit != Verdict::yes) return std::nullopt;
    const Vec3 point = eye + truth.distance_m * direction, normal = judge_.vertices(truth.face)->normal();
    std::size_t free = 0, unsure = 0;
    const Vec3 sun = request_.sun.direction, across = sun.unit_orthogonal(), up = sun.cross(across);
    for (std::size_t r = 0; r < kRays; ++r) {
      const double n = static_cast<double>(r), radius = std::tan(0.2666 * kDegree) * std::sqrt((n + 0.5) / kRays),
                   turn = n * std::numbers::pi * (3 - std::sqrt(5.0));
      const Vec3 toward = (sun + radius * (std::cos(turn) * across + std::sin(turn) * up)).normalized();
      if (!(normal.dot(toward) > 0)) continue;
      const Verdict blocked = judge_.sun_blocked(point, truth.face, toward);
      free += blocked == Verdict::no, unsure += blocked == Verdict::unknown;
    }
    // Along a facet in the Sun's plane the judge can't tell either.
    return unsure > kRays / 200 ? std::nan("") : static_cast<double>(free) / kRays;
  }

  void add(std::size_t pixel, double share, bool in_penumbra, PenumbraFindings& out) const {
    const double error = std::abs(static_cast<double>(drawn_.lit[pixel]) - share),
                 of_rays = std::abs(static_cast<double>(traced_.lit[pixel]) - share);
    if (std::isnan(share)) {
      ++out.undecided;
    } else if (!in_penumbra) {
      out.others_off += error > 0.01, ++out.others;
    } else {
      out.zbuffer.add(error), out.errors.push_back(error), out.rays.add(of_rays);
      if (std::max(error, of_rays) > 0.05)
        fmt::print("  Sun {}, tilt {}, pixel {}: {:.3f}, rays {:.3f}, judge {:.3f}\n", elevation_, tilt_deg_, pixel,
                   drawn_.lit[pixel], traced_.lit[pixel], share);
      out.far_off += error > 0.05;
    }
  }

  const Judge& judge_;
  double tilt_deg_, elevation_;
  engine::FrameRequest request_;
  engine::FrameProducts drawn_, traced_;
};

// With full effort many more pixels are judged, and so few may be off as we say.
// Each view with two of the Suns, or with the third one; each with all of them by full effort.
enum class Suns { two, third };

void judge_penumbrae(const Scenery& scenery, const std::vector<Seen>& views, Suns suns,
                     const std::vector<double>& elevations = {2.0, 15.0, 45.0}) {
  const std::size_t most_judged = full_effort() ? 1200 : suns == Suns::two ? 30 : 60;
  PenumbraFindings found;
  std::size_t pair = 0;
  for (const double elevation : elevations)
    for (const Seen& seen : views) {
      const bool third = pair % 3 == pair / 3 % 3;
      ++pair;
      if (third != (suns == Suns::third) && !full_effort()) continue;
      PenumbraView(scenery, seen, elevation).judge(most_judged, found);
    }
  std::vector<double>& errors = found.errors;
  std::sort(errors.begin(), errors.end());
  ASSERT_GT(errors.size(), 100U);
  const auto within = [&](std::size_t per_thousand) { return errors[(errors.size() - 1) * per_thousand / 1000]; };
  fmt::print(
      "{} pixels in the penumbra: z-buffer off by {:.4f} on average, 99 % within {:.4f}, 99.9 % within {:.4f}, {} by "
      "more than 0.05, at worst {:.3f}; rays by {:.4f}, at worst {:.3f}; of {} others {}; {} undecided\n",
      errors.size(), found.zbuffer.mean(), within(990), within(999), found.far_off, found.zbuffer.worst,
      found.rays.mean(), found.rays.worst, found.others, found.others_off, found.undecided);
  if (full_effort())
    EXPECT_LT(within(999), 0.015);
  else
    EXPECT_LT(within(990), 0.015);
  EXPECT_LE(found.far_off, errors.size() / 1000);
  EXPECT_LE(found.others_off, found.others / 1000);
  EXPECT_LT(found.zbuffer.mean(), 0.002);
  EXPECT_LT(found.rays.mean(), 0.005);
  EXPECT_LT(found.rays.worst, 0.06);
}

TEST_F(PenumbraOverRelief, AgainstAThousandRaysInDouble) {
  judge_penumbrae(scenery(), {{-10, 44, 20000, 0, 50}, {-10, 44, 20000, 60, 25}, {-10.3, 44, 3500, 83, 20}}, Suns::two);
}

TEST(PenumbraOverHadley, AgainstAThousandRaysInDouble) {
  const std::string folder = shared_data("hadley");
  SELENOGRAPH_SKIP_WITHOUT(folder);
  const TemporaryFolder cache;
  const Scenery scenery(folder, cache.path());
  judge_penumbrae(scenery, {{26, 3.6, 20000, 0, 50}, {25.7, 3.4, 20000, 60, 25}, {25.5, 3.2, 5000, 80, 20}},
                  Suns::third);
}

// Far above the datum: many points are centimetres to metres before what shades them, and facets face a part of the
// disc.
TEST(PenumbraOverHighGround, AgainstAThousandRaysInDouble) {
  const TemporaryFolder folder;
  constexpr int kPosts = 1024;
  write_kaguya_tile(folder / "dem", 2, 10, 1, kPosts, [](double lat, double lon) {
    const double x = lon * kPosts, y = lat * kPosts;
    std::mt19937 random(static_cast<unsigned>(std::lround(y) * 100003 + std::lround(x)));
    return 6000 + 25 * std::sin(x / 12) * std::cos(y / 9) + std::uniform_real_distribution(-1.5, 1.5)(random);
  });
  judge_penumbrae(Scenery(folder / "dem"), {{1.5, 10.5, 9000, 0, 50}, {1.3, 10.4, 9000, 40, 40}}, Suns::two, {1, 3, 5});
}

}  // namespace
}  // namespace selenograph::test
