// The Moon without relief: light and shadow, radiance and limb have formulas, at every pixel.
//
// The mesh is of chords, so its surface lies between the sphere and the sphere lowered by the chords' sag: never above,
// never deeper than what the frame promises (2 mm on the finest level). What a ray meets therefore lies between its
// meetings with those two spheres, and every product between the formula's values there. That is the tolerance.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "dem/grid/lattice.h"
#include "tests/support/effort.h"
#include "tests/support/moon_without_relief.h"
#include "tests/support/queries.h"
#include "tests/support/views.h"

namespace selenograph::test {
namespace {

using SmoothSphere = MoonWithoutRelief;

Vec3 ray_of(const engine::FrameRequest& q, int pixel) {
  const engine::Camera& c = q.camera;
  return (q.pose.camera_from_moon.conjugate() *
          Vec3((pixel % c.width - c.cx) / c.fx, (pixel / c.width - c.cy) / c.fy, 1))
      .normalized();
}

// ---- shadows -------------------------------------------------------------------------------------------------------

TEST_F(SmoothSphere, HasNoShadowButTheNight) {
  // Within one post of the terminator a facet may face the other way; nowhere else.
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> unit(0, 1);
  fmt::print("{:<12} {:>8} {:>12} {:>14} {:>14}\n", "max_error_px", "pixels", "post m", "dark by day", "lit by night");
  struct Setting {
    double max_error_px, highest_m;
  };
  for (const auto& [max_error_px, highest_m] :
       {Setting{0, 1e5}, Setting{0.01, 1e6}, Setting{0.5, 4e8}, Setting{4, 4e8}}) {
    std::size_t seen = 0, dark = 0, lit = 0;
    double coarsest = 0, day_m = 0, night_m = 0;
    for (int k = 0; k < cases(48); ++k) {
      // A place on the terminator, seen from 1 to 400 000 km; every tenth one at a pole.
      const double lat = k % 10 == 0 ? 90 : k % 10 == 1 ? -90 : std::asin(2 * unit(random) - 1) / kDegree;
      const double lon = 360 * unit(random), azimuth = 360 * unit(random);
      const double height = 1000 * std::pow(highest_m / 1000, unit(random));
      engine::FrameRequest q = blank_request();
      q.camera = square_camera(32, height > 1e6 ? 30 * 1.7e6 / height * unit(random) : 60);
      const Vec3 from = to_cartesian({lat, lon, height});
      q.pose = looking(from, -from, local_axes(from).north);
      q.sun.direction = local_sun(lat, lon, azimuth, 0.2 * (unit(random) - 0.5) * std::min(1.0, height / 1e5));
      q.accuracy.max_error_px = max_error_px;
      q.products = engine::kLit | engine::kPosition | engine::kRadiance | engine::kGsd;
      const engine::Frame frame = renderer().render(q);
      for (std::size_t i = 0; i < frame.products.lit.size(); ++i) {
        if (std::isnan(frame.products.lit[i])) continue;
        ++seen;
        const double sun_m = at3(frame.products.position, i).normalized().dot(q.sun.direction) * kMoonRadius_m;
        const double post_m = static_cast<double>(frame.products.gsd[i]);
        coarsest = std::max(coarsest, post_m);
        if (frame.products.lit[i] == 0) day_m = std::max(day_m, sun_m / post_m);
        if (frame.products.lit[i] != 0) night_m = std::max(night_m, -sun_m / post_m);
        dark += frame.products.lit[i] == 0 && sun_m > post_m;
        lit += frame.products.lit[i] != 0 && sun_m < 0;
        EXPECT_EQ(frame.products.radiance[i] > 0, frame.products.lit[i] > 0);
      }
    }
    fmt::print("{:<12} {:8} {:12.0f} {:8} {:5.2f} {:8} {:5.2f}   (farthest from the terminator, posts)\n", max_error_px,
               seen, coarsest, dark, day_m, lit, night_m);
    EXPECT_GT(seen, static_cast<std::size_t>(cases(48)) * 500);
    EXPECT_EQ(dark, 0U);
    EXPECT_EQ(lit, 0U);
    EXPECT_GT(day_m, 0) << "the terminator is in view";
  }
}

// ---- radiance ------------------------------------------------------------------------------------------------------

TEST_F(SmoothSphere, NormalsHoldWhereTheLatticeChangesItsStep) {
  // Rows of level 8 (0.25 degrees) whose step of longitude is twice that of the row below: vertices collapse there.
  std::vector<engine::Ray> rays;
  for (const double lat : {-86.5, -75.75, 75.75, 83.0, 88.25})
    for (int i = 0; i < 4000; ++i) {
      const Vec3 from = to_cartesian({lat + 0.002 * (i % 101 - 50), 0.0021 * i, 1000});
      rays.push_back({from, -from.normalized()});
    }
  double off = 0;
  for (const engine::RayHit& hit : test::cast_rays(renderer(), rays)) {
    ASSERT_TRUE(hit.hit);
    off = std::max(off, (hit.normal - hit.position_m.normalized()).norm());
  }
  fmt::print("normals off the vertical by at most {:.1e} rad\n", off);
  // Between posts of 1.9 km normals are interpolated along parallels, which curve.
  EXPECT_LT(off, 1e-6);
}

// ---- limb ----------------------------------------------------------------------------------------------------------

struct LimbView {
  const char* name;
  double height_m, fov_deg;
  bool at_limb;  // the boresight passes the Moon by a tenth of the image; else it points at the Moon's centre
};

// How far, in pixels of the camera, a direction lies outside of the tangent cone (half angle asin(R / d)): the limb.
double pixels_outside_limb(const engine::FrameRequest& q, const Vec3& direction) {
  const Vec3 down = -q.pose.position_m.normalized();
  const Vec3 boresight = q.pose.camera_from_moon.conjugate() * Vec3::unit_z();
  const double angle = std::atan2(direction.cross(down).norm(), direction.dot(down));
  const double along = direction.dot(boresight);
  return (angle - std::asin(kMoonRadius_m / q.pose.position_m.norm())) * q.camera.fx / (along * along);
}

// A magnifying glass: the same camera with `magnification` times the focal length, its principal point moved so that a
// place of the original image lies in the middle. The error bound grows along, so the mesh stays the same.
engine::FrameRequest magnified(const engine::FrameRequest& q, double x, double y, int size, double magnification) {
  engine::FrameRequest m = q;
  m.camera.width = m.camera.height = size;
  m.camera.fx *= magnification, m.camera.fy *= magnification;
  m.camera.cx = (size - 1) / 2.0 - (x - q.camera.cx) * magnification;
  m.camera.cy = (size - 1) / 2.0 - (y - q.camera.cy) * magnification;
  m.accuracy.max_error_px *= magnification;
  return m;
}

struct LimbError {
  double px = 0, promised_px = 0;
  std::size_t triangles = 0;
  // Of hits and misses on the wrong side of the limb, the farthest; seen through the glass at one place of the limb.
  void look(const engine::Renderer& renderer, const engine::FrameRequest& q, const Vec2& place) {
    constexpr int kGlass = 64;
    const double magnification = kGlass / std::max(0.04, 2 * q.accuracy.max_error_px);
    const engine::FrameRequest m = magnified(q, place.x(), place.y(), kGlass, magnification);
    const engine::Frame frame = renderer.render(m);
    promised_px = std::max(promised_px, frame.report.lod_error_px / magnification);
    triangles = std::max(triangles, frame.report.triangles);
    std::size_t hits = 0;
    for (int i = 0; i < kGlass * kGlass; ++i) {
      const double outside = pixels_outside_limb(q, ray_of(m, i));
      const bool hit = !std::isnan(frame.products.depth[static_cast<std::size_t>(i)]);
      hits += hit;
      px = std::max(px, hit ? outside : -outside);
    }
    EXPECT_GT(hits, kGlass * kGlass / 8) << "the limb is in the glass";
    EXPECT_LT(hits, kGlass * kGlass * 7 / 8);
  }
};

// The limb's place in the image on the way out from the Moon's centre, at an angle in the image.
Vec2 limb_at(const engine::FrameRequest& q, double angle) {
  const Vec3 position = q.pose.position_m, down = -position.normalized();
  const Vec3 side = q.pose.camera_from_moon.conjugate() * Vec3(std::cos(angle), std::sin(angle), 0);
  const Vec3 across = (side - side.dot(down) * down).normalized();
  const double half = std::asin(kMoonRadius_m / position.norm());
  const Vec3 c = q.pose.camera_from_moon * (std::cos(half) * down + std::sin(half) * across);
  return {q.camera.fx * c.x() / c.z() + q.camera.cx, q.camera.fy * c.y() / c.z() + q.camera.cy};
}

TEST_F(SmoothSphere, LimbIsWhereTheTangentConeIs) {
  const LimbView views[] = {
      {"whole Moon, 400 000 km", 4e8, 0.55, false}, {"whole Moon, 4000 km", 4e6, 40, false},
      {"horizon, 100 km", 1e5, 150, false},         {"horizon, 20 km, 5 deg", 2e4, 5, true},
      {"limb, 4000 km, 0.1 deg", 4e6, 0.1, true},   {"limb, 400 000 km, 0.01 deg", 4e8, 0.01, true}};
  fmt::print("{:<28} {:>12} {:>9} {:>9} {:>12} {:>10}\n", "view", "max_error_px", "m/pixel", "limb px", "promised px",
             "triangles");
  for (const LimbView& v : views)
    for (const double max_error_px : {0.0, 0.01, 0.5}) {
      SCOPED_TRACE(fmt::format("{}, max_error_px {}", v.name, max_error_px));
      engine::FrameRequest q = blank_request();
      q.camera = square_camera(1024, v.fov_deg);
      const Vec3 from = to_cartesian({33, -70, v.height_m});
      const EastNorthUp axes = local_axes(from);
      const double half = std::asin(kMoonRadius_m / from.norm()), tilt = half + 0.1 * v.fov_deg * kDegree;
      q.pose = looking(from, v.at_limb ? Vec3(std::sin(tilt) * axes.east - std::cos(tilt) * axes.up) : Vec3(-from),
                       axes.north);
      q.accuracy.max_error_px = max_error_px;
      q.products = engine::kDepth;
      LimbError limb;
      const Vec3 toward_limb = q.pose.camera_from_moon * axes.east;
      for (int k = 0; k < (v.at_limb ? 5 : 16); ++k) {
        // All around; or along the piece of limb that is in the image.
        const double angle = v.at_limb ? std::atan2(toward_limb.y(), toward_limb.x()) +
                                             (k - 2) * 0.1 * v.fov_deg * kDegree / std::sin(half)
                                       : 0.1 + k * kDegree * 22.5;
        limb.look(renderer(), q, limb_at(q, angle));
      }
      const double limb_m = std::cos(half) * from.norm();
      fmt::print("{:<28} {:12} {:9.3g} {:9.5f} {:12.5f} {:10}\n", v.name, max_error_px, limb_m / q.camera.fx, limb.px,
                 limb.promised_px, limb.triangles);
      EXPECT_LE(limb.px, std::max(0.01, limb.promised_px));
      if (max_error_px <= 0.01) {
        EXPECT_LE(limb.px, 0.01);
      }
    }
}

}  // namespace
}  // namespace selenograph::test
