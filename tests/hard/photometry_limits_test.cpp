// Reflectance where its cosines end: denormal, zero, one, and the rows of pixels where frames have them. Conditions (5)
// to (7) of the paper in between are unit/brdf_test.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "engine/radiometry/photometry.h"
#include "engine/renderer.h"
#include "tests/support/float_tiles.h"
#include "tests/support/hard_views.h"
#include "tests/support/reflectance.h"
#include "tests/support/shared_data.h"

namespace selenograph::test {
namespace {

using engine::Reflectance;
using engine::ReflectanceModel;

constexpr double kDenormal = std::numeric_limits<double>::denorm_min();
constexpr double kSmallest = std::numeric_limits<double>::min();
constexpr double kJustBelowOne = 1 - 0x1p-53;
constexpr std::array kCosines{kDenormal, 1e-320, kSmallest, 1e-300, 1e-160,   1e-20,         0x1p-53,
                              1e-9,      1e-3,   0.5,       0.9,    1 - 1e-9, kJustBelowOne, 1.0};

std::vector<Reflectance> models() {
  std::vector<Reflectance> all;
  for (const double rho : {0.12, 1.0}) {
    all.push_back({ReflectanceModel::lambert, 1, rho});
    all.push_back({ReflectanceModel::lommel_seeliger, 1, rho});
    for (const double weight : {0.0, kDenormal, 0.35, kJustBelowOne, 1.0})
      all.push_back({ReflectanceModel::lommel_seeliger_lambert, weight, rho});
  }
  return all;
}

double seeliger_share(const Reflectance& r) {
  if (r.model == ReflectanceModel::lambert) return 0;
  return r.model == ReflectanceModel::lommel_seeliger ? 1 : r.lommel_seeliger_weight;
}

// f_r itself has no bound: 1 / (mu0 + mu) overflows once mu0 + mu is below 1e-309 or so. Everywhere else it is finite,
// positive (5) and its own mirror (6), bit for bit.
TEST(PhotometryLimits, ReflectanceIsPositiveFiniteAndReciprocal) {
  int overflows = 0, cases = 0;
  for (const Reflectance& model : models())
    for (const double mu0 : kCosines)
      for (const double mu : kCosines) {
        const double f = test::brdf(model, mu0, mu);
        ++cases;
        EXPECT_GT(f, 0) << mu0 << ' ' << mu;
        EXPECT_EQ(f, test::brdf(model, mu, mu0)) << mu0 << ' ' << mu;
        overflows += std::isinf(f);
        EXPECT_EQ(std::isinf(f), std::isinf(test::terms_of(model).lommel_seeliger / (mu0 + mu)));
        if (mu0 + mu >= kSmallest) {
          EXPECT_TRUE(std::isfinite(f)) << mu0 << ' ' << mu;
        }
      }
  fmt::print("reflectance overflows in {} of {} cases, all of denormal mu0 + mu\n", overflows, cases);
  EXPECT_GT(overflows, 0) << "the cases reach no denormal sum";
}

// What radiance is made of is bounded all the same: mu0 / (mu0 + mu) is at most 1.
TEST(PhotometryLimits, RadianceIsFiniteAndBoundedWhereReflectanceIsNot) {
  constexpr double kIrradiance = 1361;
  double largest = 0;
  for (const Reflectance& model : models())
    for (const double mu0 : kCosines)
      for (const double mu : {0.0, kDenormal, 1e-320, kSmallest, 1e-300, 1e-20, 1e-9, 0.5, 1.0}) {
        const double radiance = test::direct_radiance(model, kIrradiance, mu0, mu, 1);
        const double w = seeliger_share(model);
        const double bound =
            kIrradiance * model.rho * (w / (2 * std::numbers::pi) + (1 - w) * mu0 / std::numbers::pi) * (1 + 4e-16);
        EXPECT_GE(radiance, 0) << mu0 << ' ' << mu;
        EXPECT_LE(radiance, bound + kIrradiance * kDenormal) << mu0 << ' ' << mu;
        EXPECT_TRUE(std::isfinite(static_cast<float>(radiance))) << mu0 << ' ' << mu;
        largest = std::max(largest, radiance);
      }
  fmt::print("largest radiance {:.6g} W m-2 sr-1 of {:.6g} possible\n", largest, kIrradiance / std::numbers::pi);
}

// (7) down to grazing incidence. Over mu the integrand bends within mu0 of zero: substituting mu = mu0 (e^t - 1) makes
// it smooth, so that Simpson's rule is exact to 1e-9 at any mu0.
double directional_hemispherical(const Reflectance& model, double mu0) {
  const double last = std::log1p(1 / mu0);
  const int steps = 2 * static_cast<int>(std::ceil(last / 0.01));
  const double h = last / steps;
  double sum = 0;
  for (int i = 0; i <= steps; ++i) {
    const double mu = mu0 * std::expm1(i * h), slope = mu0 * std::exp(i * h);
    const double weight = i == 0 || i == steps ? 1 : i % 2 ? 4 : 2;
    sum += weight * test::brdf(model, mu0, mu) * mu * slope;
  }
  return 2 * std::numbers::pi * sum * h / 3;
}

TEST(PhotometryLimits, EnergyIsConservedDownToGrazingIncidence) {
  double worst = 0;
  for (const Reflectance& model : models())
    for (const double mu0 : {1e-300, 1e-160, 1e-20, 1e-9, 1e-6, 1e-3, 0.1, 0.5, kJustBelowOne, 1.0}) {
      const double reflected = directional_hemispherical(model, mu0), w = seeliger_share(model);
      const double expected = model.rho * (w * (1 - mu0 * std::log1p(1 / mu0)) + (1 - w));
      EXPECT_LE(reflected, model.rho * (1 + 1e-9)) << mu0;
      worst = std::max(worst, std::abs(reflected - expected) / model.rho);
    }
  fmt::print("hemispherical reflectance against its closed form: off by {:.1e} of rho at most\n", worst);
  EXPECT_LT(worst, 1e-9);
}

// ---- whole frames --------------------------------------------------------------------------------------------------

double waves(double lat_deg, double lon_deg) {
  return 2000 * std::sin(1.3 * lat_deg) * std::sin(1.1 * lon_deg) * std::cos(lat_deg * kDegree);
}

// All of the Moon in one frame, smooth and with relief, at all phases: limb, terminator and their meeting points.
TEST(PhotometryLimits, NoPixelOfTheMoonsDiscIsNotANumber) {
  std::size_t pixels = 0, bright = 0, grazing = 0;
  for (const bool relief : {false, true}) {
    TemporaryFolder folder;
    write_global_tile(
        folder.path(), 2, relief ? HeightFunction(waves) : [](double, double) { return 0.0; });
    const engine::Renderer renderer(open_terrain(folder.path()), engine::RendererOptions{});
    for (const double phase_deg : {0.0, 90.0, 150.0, 180.0})
      for (const Reflectance& model :
           {Reflectance{ReflectanceModel::lommel_seeliger, 1, 1}, Reflectance{ReflectanceModel::lambert, 1, 1},
            Reflectance{ReflectanceModel::lommel_seeliger_lambert, 0.35, 1}}) {
        const Vec3 sun = local_direction(to_cartesian({10, 30, 0}), 70, 90 - phase_deg);
        engine::FrameRequest request = nadir_view({10, 30, 400000e3}, 96, 0.5, sun);
        request.accuracy.max_error_px = 0.5;
        request.reflectance = model;
        request.products |= engine::kAngles;
        const engine::FrameProducts p = renderer.render(request).products;
        const double w = seeliger_share(model),
                     most = 1361 * (w / (2 * std::numbers::pi) + (1 - w) / std::numbers::pi) * (1 + 1e-6);
        for (std::size_t i = 0; i < p.radiance.size(); ++i) {
          ++pixels;
          ASSERT_TRUE(std::isfinite(p.radiance[i]) && !std::signbit(p.radiance[i])) << phase_deg << " pixel " << i;
          ASSERT_LE(static_cast<double>(p.radiance[i]), most);
          if (std::isnan(p.depth[i])) {
            ASSERT_EQ(p.radiance[i], 0.F);
            continue;
          }
          for (std::size_t k = 3 * i; k < 3 * i + 3; ++k)
            ASSERT_TRUE(p.angles[k] >= 0 && p.angles[k] <= 180) << phase_deg << " pixel " << i;
          ASSERT_TRUE(p.lit[i] == 0.F || p.lit[i] == 1.F);
          ASSERT_NEAR(at3(p.normal, i).norm(), 1, 1e-6);
          bright += p.radiance[i] > 0;
          grazing += p.angles[3 * i] > 85 || p.angles[3 * i + 1] > 85;
        }
      }
  }
  fmt::print("{} pixels: {} bright, {} within 5 degrees of grazing; none negative, infinite or not a number\n", pixels,
             bright, grazing);
  EXPECT_GT(bright, 20000u);
  EXPECT_GT(grazing, 10000u);
}

}  // namespace
}  // namespace selenograph::test
