// The Sun's disc as light: closed forms and quadratures against sums over very many places of it.
#include "engine/visibility/points/disc_light.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "tests/support/effort.h"

namespace selenograph::engine {
namespace {

constexpr double kRadius_deg = 0.2666;

Sun sun(double limb_darkening) {
  Sun s;
  s.direction = Vec3(1, 2, 3).normalized();
  s.angular_radius_deg = kRadius_deg, s.limb_darkening = limb_darkening;
  return s;
}

// Midpoints of rings and of arcs on them: work(x, y, share of the disc's light).
template <typename Work>
void over_disc(double u, const Work& work) {
  constexpr int kRings = 300, kArcs = 600;
  for (int r = 0; r < kRings; ++r) {
    const double radius = (r + 0.5) / kRings, bright = 1 - u * (1 - std::sqrt(1 - radius * radius));
    const double light = bright * radius / kRings * 2 * std::numbers::pi / kArcs / (std::numbers::pi * (1 - u / 3));
    for (int a = 0; a < kArcs; ++a) {
      const double turn = 2 * std::numbers::pi * (a + 0.5) / kArcs;
      work(radius * std::cos(turn), radius * std::sin(turn), light);
    }
  }
}

template <typename Free>
DiscShare summed(double u, const DiscPlane& facet, const DiscPlane& shading, const Free& free) {
  DiscShare sum;
  over_disc(u, [&](double x, double y, double light) {
    if (facet.at(x, y) <= 0 || !free(x, y)) return;
    sum.share += light, sum.cosine += light * std::max(0.0, shading.at(x, y));
  });
  return sum;
}

TEST(DiscLight, ItsAxesAreLevelAndUpward) {
  const Sun s = sun(0);
  const Vec3 up = Vec3(0.2, -0.1, 1).normalized();
  const DiscLight disc(s, up);
  const double radius = kRadius_deg * kRadiansPerDegree;
  EXPECT_NEAR(std::asin(disc.direction(0, 1).dot(up)) - std::asin(s.direction.dot(up)), radius, 1e-6);
  EXPECT_NEAR(disc.direction(1, 0).dot(up), s.direction.dot(up), 1e-4);
  EXPECT_NEAR(std::acos(disc.direction(1, 0).dot(s.direction)), radius, 1e-9);
}

// Planes at every height over the disc, facet and normal alike or turned apart.
TEST(DiscLight, AFacetAloneReceivesTheClosedForm) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> any(-1, 1);
  double worst_share = 0, worst_cosine = 0;
  for (const double u : {0.0, 0.6, 1.0})
    for (int i = 0; i < 60; ++i) {
      const DiscLight disc(sun(u), Vec3::unit_z());
      const double r = disc.radius(), turn = std::numbers::pi * any(random);
      const DiscPlane facet{1.3 * r * any(random), r * std::cos(turn), r * std::sin(turn)};
      DiscPlane shading = facet;
      if (i % 3 == 1) shading.middle += 0.5 * r * any(random);
      if (i % 3 == 2) {
        const double other = turn + any(random);
        shading = {1.3 * r * any(random), r * std::cos(other), r * std::sin(other)};
      }
      const DiscShare expected = summed(u, facet, shading, [](double, double) { return true; });
      const DiscShare found = disc.unoccluded(facet, shading);
      worst_share = std::max(worst_share, std::abs(found.share - expected.share));
      worst_cosine = std::max(worst_cosine, std::abs(found.cosine - expected.cosine) / r);
    }
  fmt::print("share off by {:.1e} at worst, mean cosine by {:.1e} of the disc's radius\n", worst_share, worst_cosine);
  EXPECT_LT(worst_share, 1e-3);
  EXPECT_LT(worst_cosine, 1e-3);
}

// Level ground: Sun's centre at 0 degrees, (2 / 3 pi) of the radius.
TEST(DiscLight, LevelGroundAtSunset) {
  const DiscLight disc(sun(0), Vec3::unit_z());
  const double r = disc.radius();
  const DiscPlane level{0, 0, r};
  EXPECT_NEAR(disc.unoccluded(level, level).share, 0.5, 1e-12);
  EXPECT_NEAR(disc.unoccluded(level, level).cosine, 2 / (3 * std::numbers::pi) * r, 1e-12);
  const DiscPlane above{r, 0, r};
  EXPECT_NEAR(disc.unoccluded(above, above).cosine, r, 1e-12) << "its lower rim on the horizon: the middle's cosine";
}

// A horizon that is straight in the sky, at every height and up to 45 degrees steep.
TEST(DiscLight, StraightHorizonsLeaveWhatIsAboveThem) {
  for (const double u : {0.0, 0.6}) {
    const DiscLight disc(sun(u), Vec3::unit_z());
    const double r = disc.radius();
    const DiscPlane high{0.3, 0.1 * r, r};
    double sum = 0, worst = 0, worst_cosine = 0;
    int n = 0;
    const double step = test::full_effort() ? 1 : 2;
    for (double slope = -1; slope <= 1; slope += 0.125 * step)
      for (double height = -1.3; height <= 1.3; height += 0.05 * step) {
        DiscLanes turned{};
        float horizons[DiscLight::kColumns][kPacket], share[kPacket], cosine[kPacket];
        for (int i = 0; i < kPacket; ++i) {
          for (int j = 0; j < DiscLight::kColumns; ++j)
            horizons[j][i] = static_cast<float>(height + slope * static_cast<double>(disc.column(j)));
          for (DiscPlanes* p : {&turned.facet, &turned.shading})
            p->middle[i] = static_cast<float>(high.middle), p->across[i] = static_cast<float>(high.across),
            p->upward[i] = static_cast<float>(high.upward);
        }
        disc.remaining(horizons, turned, share, cosine);
        // The same by the shorter way of points that face all of the disc.
        float whole_share[kPacket], whole_cosine[kPacket];
        turned.facing_all = kAllLanes;
        std::fill_n(turned.tilt_across, kPacket, static_cast<float>(high.across / high.middle));
        std::fill_n(turned.tilt_upward, kPacket, static_cast<float>(high.upward / high.middle));
        disc.remaining(horizons, turned, whole_share, whole_cosine);
        EXPECT_NEAR(whole_share[5], share[5], 1e-4);
        EXPECT_NEAR(whole_cosine[5], cosine[5], 1e-4);
        const DiscShare expected = summed(u, high, high, [&](double x, double y) { return y > height + slope * x; });
        const double error = std::abs(static_cast<double>(share[5]) - expected.share);
        sum += error, worst = std::max(worst, error), ++n;
        worst_cosine = std::max(worst_cosine, std::abs(static_cast<double>(cosine[5]) - expected.cosine / 0.3));
        EXPECT_EQ(share[0], share[15]);
      }
    fmt::print("limb darkening {}: off by {:.4f} of the disc on average, {:.4f} at worst\n", u, sum / n, worst);
    EXPECT_LT(sum / n, 0.0015);
    EXPECT_LT(worst, 0.008);
    EXPECT_LT(worst_cosine, 0.008);
  }
}

// The facet and the terrain before it both hide a part: light is left only above both.
TEST(DiscLight, AGrazedFacetUnderAHorizon) {
  const DiscLight disc(sun(0), Vec3::unit_z());
  const double r = disc.radius();
  const DiscPlane facet{0.2 * r, 0.3 * r, 0.9 * r};
  DiscLanes turned{};
  float horizons[DiscLight::kColumns][kPacket], share[kPacket], cosine[kPacket];
  for (int i = 0; i < kPacket; ++i) {
    for (auto& column : horizons) column[i] = 0.1F * static_cast<float>(i - 8);
    for (DiscPlanes* p : {&turned.facet, &turned.shading})
      p->middle[i] = static_cast<float>(facet.middle), p->across[i] = static_cast<float>(facet.across),
      p->upward[i] = static_cast<float>(facet.upward);
  }
  disc.remaining(horizons, turned, share, cosine);
  const DiscShare alone = disc.unoccluded(facet, facet);
  for (int i = 0; i < kPacket; ++i) {
    const DiscShare expected = summed(0, facet, facet, [&](double, double y) { return y > 0.1 * (i - 8); });
    EXPECT_NEAR(alone.share * static_cast<double>(share[i]), expected.share, 0.01) << i;
    EXPECT_NEAR(alone.cosine * static_cast<double>(cosine[i]), expected.cosine, 0.01 * r) << i;
  }
}

TEST(DiscLight, DirectionsHaveEqualLight) {
  for (const double u : {0.0, 0.6}) {
    const DiscLight disc(sun(u), Vec3::unit_z());
    std::array<double, DiscLight::kDirections> within{};
    for (std::size_t k = 0; k < within.size(); ++k) {
      const auto [x, y] = disc.disc_points()[k];
      const double r2 = x * x + y * y;
      // The integral of 1 - u (1 - sqrt(1 - r^2)) over the disc within r, over that of the whole.
      within[k] = ((1 - u) * r2 + u * 2 / 3 * (1 - std::pow(1 - r2, 1.5))) / (1 - u / 3);
      EXPECT_NEAR((disc.directions()[k] - disc.direction(x, y)).norm(), 0, 1e-15);
    }
    for (std::size_t k = 1; k < DiscLight::kScouts; ++k) EXPECT_GT(within[k], 0.95) << "the rim";
    std::sort(within.begin(), within.end());
    for (std::size_t k = 0; k < within.size(); ++k)
      EXPECT_NEAR(within[k], (static_cast<double>(k) + 0.5) / DiscLight::kDirections, 1e-9);
  }
}

// Whatever stands there, rays are asked: a straight edge at every height and angle, upright ones included.
TEST(DiscLight, DirectionsPastAStraightEdge) {
  const DiscLight disc(sun(0), Vec3::unit_z());
  double sum = 0, worst = 0;
  int n = 0, asked = 0;
  for (double turn = 0; turn < 2 * std::numbers::pi; turn += 0.21)
    for (double height = -1.1; height <= 1.1; height += 0.01) {
      DiscLanes turned{};
      float lit[kPacket];
      double incident[kPacket];
      for (int i = 0; i < kPacket; ++i)
        turned.facet.middle[i] = turned.shading.middle[i] = 0.5F, lit[i] = 1, incident[i] = 0.5;
      const auto blocked = [&](std::uint32_t asking, const Vec3& toward) {
        ++asked;
        const Vec3 off = (toward - disc.direction(0, 0)) / disc.radius();
        const Vec3 x = (disc.direction(1, 0) - disc.direction(0, 0)) / disc.radius(),
                   y = (disc.direction(0, 1) - disc.direction(0, 0)) / disc.radius();
        return std::cos(turn) * off.dot(x) + std::sin(turn) * off.dot(y) < height ? asking : 0;
      };
      disc.remove_blocked(blocked, 0xffff, turned, lit, incident);
      const double h = std::clamp(height, -1.0, 1.0),
                   expected = (std::acos(h) - h * std::sqrt(1 - h * h)) / std::numbers::pi;
      const double error = std::abs(static_cast<double>(lit[3]) - expected);
      if (std::abs(height) < 1) sum += error, ++n;
      worst = std::max(worst, error);
      if (lit[3] > 0) {
        EXPECT_NEAR(incident[3], 0.5, 1e-6);
      }
    }
  fmt::print("off by {:.4f} of the disc on average, {:.4f} at worst\n", sum / n, worst);
  EXPECT_LT(sum / n, 0.005);
  EXPECT_LT(worst, 0.02);
}

TEST(DiscLight, UnobstructedSunNeedsOnlyScoutRays) {
  const DiscLight disc(sun(0), Vec3::unit_z());
  DiscLanes turned{};
  float lit[kPacket];
  double incident[kPacket];
  for (int i = 0; i < kPacket; ++i) turned.facet.middle[i] = turned.shading.middle[i] = 0.5F, lit[i] = 1;
  // Of a facet that faces a part of the disc, a few scouts may agree by chance.
  for (const std::uint32_t whole : {0xffffU, 0xfffeU})
    for (const std::uint32_t answer : {0U, 0xffffU}) {
      turned.facing_all = whole, lit[0] = 1;
      int asked = 0;
      disc.remove_blocked([&](std::uint32_t, const Vec3&) { return ++asked, answer; }, 0xffff, turned, lit, incident);
      EXPECT_EQ(asked, whole == 0xffff ? DiscLight::kScouts : DiscLight::kDirections);
      EXPECT_EQ(lit[0], answer ? 0 : 1);
    }
}

// The facet faces the disc, the interpolated normal a sliver of it between the places: half of the disc is free.
TEST(DiscLight, OfASliverHalfIsLeft) {
  const DiscLight disc(sun(0), Vec3::unit_z());
  DiscLanes turned{};
  float lit[kPacket] = {1};
  double incident[kPacket] = {1e-6};
  turned.facet.middle[0] = 0.5F, turned.shading.middle[0] = -1e-3F;
  const Vec3 middle = disc.direction(0, 0), across = disc.direction(1, 0) - middle;
  disc.remove_blocked([&](std::uint32_t, const Vec3& d) { return (d - middle).dot(across) > 0 ? 1U : 0U; }, 1, turned,
                      lit, incident);
  EXPECT_NEAR(lit[0], 0.5F, 0.01F);
  EXPECT_DOUBLE_EQ(incident[0], 1e-6);
}

}  // namespace
}  // namespace selenograph::engine
