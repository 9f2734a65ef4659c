// The Sun's disc as directions: their place, their share of the light, and who faces them.
#include "engine/visibility/zbuffer/sun_disc.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

namespace selenograph::engine {
namespace {

constexpr double kRadius_deg = 0.2666, kRadius = kRadius_deg * std::numbers::pi / 180;

Sun sun(double limb_darkening) {
  Sun s;
  s.direction = Vec3(1, 2, 3).normalized();
  s.angular_radius_deg = kRadius_deg, s.limb_darkening = limb_darkening;
  return s;
}

// Angle from the disc's middle over its radius.
double distance(const Sun& s, const Vec3& direction) {
  return std::atan2(s.direction.cross(direction).norm(), s.direction.dot(direction)) / kRadius;
}

TEST(DiscDirections, AnEvenDiscHasEqualAreas) {
  const Sun s = sun(0);
  const auto directions = disc_directions(s);
  Vec3 mean = Vec3::Zero();
  for (std::size_t k = 0; k < directions.size(); ++k) {
    EXPECT_NEAR(directions[k].norm(), 1, 1e-15);
    const double r = distance(s, directions[k]);
    EXPECT_NEAR(r * r, (static_cast<double>(k) + 0.5) / kDiscSamples, 1e-9);
    mean += directions[k] / kDiscSamples;
  }
  EXPECT_LT(distance(s, mean), 0.05) << "of its radius";
}

TEST(DiscDirections, ADarkenedLimbHasEqualLight) {
  const double u = 0.6;
  const Sun s = sun(u);
  const auto directions = disc_directions(s);
  for (std::size_t k = 0; k < directions.size(); ++k) {
    // The integral of 1 - u (1 - sqrt(1 - r^2)) over the disc within r, over that of the whole.
    const double r2 = std::pow(distance(s, directions[k]), 2);
    const double light = ((1 - u) * r2 + u * 2 / 3 * (1 - std::pow(1 - r2, 1.5))) / (1 - u / 3);
    EXPECT_NEAR(light, (static_cast<double>(k) + 0.5) / kDiscSamples, 1e-9);
  }
}

SurfacePoints facets(const Vec3& normal) {
  SurfacePoints p{};
  const Vec3 place = kMoonRadius_m * Vec3(1, 2, 3).normalized();  // the Sun is in the zenith
  for (int i = 0; i < kPacket; ++i) {
    p.hit[i] = true;
    p.x[i] = place.x(), p.y[i] = place.y(), p.z[i] = place.z();
    p.nx[i] = normal.x(), p.ny[i] = normal.y(), p.nz[i] = normal.z();
  }
  return p;
}

TEST(SunDisc, AFacetFacesTheDirectionsAboveItsPlane) {
  const Sun s = sun(0);
  const SunDisc disc(s);
  const Vec3 across = any_across(s.direction);
  std::int32_t faces[kPacket];
  // Tilted so that the disc's middle is so many of its radii above the facet's plane.
  for (const double above : {-1.5, -0.5, 0.0, 0.5, 1.5}) {
    const double a = above * kRadius;
    disc.faced_by(facets(std::cos(a) * across + std::sin(a) * s.direction), faces);
    // The share of a circle on one side of a chord.
    const double h = std::clamp(above, -1.0, 1.0);
    const double share = 0.5 + (h * std::sqrt(1 - h * h) + std::asin(h)) / std::numbers::pi;
    for (const std::int32_t lane : faces)
      EXPECT_NEAR(std::popcount(static_cast<std::uint32_t>(lane)), share * kDiscSamples, 1.5) << above;
  }
}

TEST(SunDisc, ItsShareIsWhatIsFacedAndNotBlocked) {
  EXPECT_EQ(SunDisc::lit_share(~0U, 0), 1);
  EXPECT_EQ(SunDisc::lit_share(~0U, kDiscSamples), 0);
  EXPECT_EQ(SunDisc::lit_share(~0U, 8), 0.75F);
  EXPECT_EQ(SunDisc::lit_share(0xffffU, 8), 0.25F);
}

}  // namespace
}  // namespace selenograph::engine
