// The linear models of reflectance: values by hand, and radiance towards limb and terminator.
#include "engine/radiometry/photometry.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/support/reflectance.h"

namespace selenograph::engine {
namespace {

TEST(Photometry, ValuesByHand) {
  const Reflectance lambert{ReflectanceModel::lambert, 1, 0.12}, seeliger{ReflectanceModel::lommel_seeliger, 1, 0.12};
  EXPECT_NEAR(test::brdf(lambert, 0.3, 0.9), 0.03819718634205488, 1e-16);  // 0.12 / pi
  // Sun and camera in the zenith: rho / (2 pi) / 2 = 0.12 / (4 pi), a quarter of Lambert.
  EXPECT_NEAR(test::brdf(seeliger, 1, 1), 0.00954929658551372, 1e-16);
  EXPECT_NEAR(test::brdf(seeliger, 0.5, 1), 0.12 / (2 * std::numbers::pi) / 1.5, 1e-16);
  EXPECT_NEAR(test::brdf({ReflectanceModel::lommel_seeliger_lambert, 0.25, 0.12}, 0.5, 1),
              0.25 * 0.12 / (3 * std::numbers::pi) + 0.75 * 0.12 / std::numbers::pi, 1e-16);
  // Overhead Sun at 1 au, nadir: 1361 * 0.12 / (4 pi) = 12.9966 W m-2 sr-1.
  EXPECT_NEAR(test::direct_radiance(seeliger, 1361, 1, 1, 1), 12.996592652884, 1e-10);
  EXPECT_NEAR(test::direct_radiance(lambert, 1361, 0.5, 0.2, 0.25), 1361 * 0.5 * 0.12 / std::numbers::pi * 0.25, 1e-12);
}

TEST(Photometry, TheWeightedAverageHasBothEnds) {
  for (const double mu0 : {0.01, 0.4, 1.0})
    for (const double mu : {0.02, 0.7}) {
      EXPECT_EQ(test::brdf({ReflectanceModel::lommel_seeliger_lambert, 1, 0.2}, mu0, mu),
                test::brdf({ReflectanceModel::lommel_seeliger, 0.5, 0.2}, mu0, mu));
      EXPECT_EQ(test::brdf({ReflectanceModel::lommel_seeliger_lambert, 0, 0.2}, mu0, mu),
                test::brdf({ReflectanceModel::lambert, 0.5, 0.2}, mu0, mu));
    }
}

TEST(Photometry, FiniteAndMonotoneTowardsLimbAndTerminator) {
  const Reflectance seeliger{ReflectanceModel::lommel_seeliger, 1, 0.12};
  for (const double mu : {0.0, 1e-300, 1e-12, 0.3, 1.0}) {
    double before = 0;
    for (double mu0 = 1e-300; mu0 <= 1; mu0 *= 10) {
      const double radiance = test::direct_radiance(seeliger, 1361, mu0, mu, 1);
      ASSERT_TRUE(std::isfinite(radiance));
      EXPECT_GE(radiance, before * (1 - 1e-15)) << mu0 << ' ' << mu;
      before = radiance;
    }
  }
  for (const double mu0 : {0.2, 1.0})
    for (double mu = 0.1; mu <= 1; mu += 0.1)
      EXPECT_LT(test::direct_radiance(seeliger, 1361, mu0, mu, 1),
                test::direct_radiance(seeliger, 1361, mu0, mu - 0.1, 1));
}

}  // namespace
}  // namespace selenograph::engine
