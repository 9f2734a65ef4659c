// The Moon's own reflectance: ROLO and LIME by hand, the disc's brightness, bands, maps of radiance factors, Sato.
#include "engine/radiometry/moon.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "engine/radiometry/brdf.h"
#include "engine/radiometry/disc_models.h"
#include "engine/radiometry/phase_law.h"
#include "engine/radiometry/sato2014.h"
#include "engine/radiometry/spectrum.h"
#include "engine/renderer.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

constexpr double kRadians = std::numbers::pi / 180;

Reflectance moon(MoonGround ground = MoonGround::mean) {
  Reflectance r{ReflectanceModel::moon};
  r.ground = ground;
  return r;
}

// Returns the disc-equivalent reflectance of a smooth sphere, integrated over it (midpoint rule, to 1e-4): photometric
// longitude from the terminator to the limb, the camera at longitude 0, and latitude.
double sphere_reflectance(const Brdf& brdf, double phase_deg) {
  constexpr double kPi = std::numbers::pi;
  constexpr int kLongitudes = 300, kLatitudes = 100;
  const double g = phase_deg * kRadians, span = kPi - g;
  double sum = 0;
  for (int j = 0; j < kLatitudes; ++j)
    for (int i = 0; i < kLongitudes; ++i) {
      const double cosine = std::cos((j + 0.5) / kLatitudes * kPi / 2);
      const double longitude = g - kPi / 2 + (i + 0.5) / kLongitudes * span;
      const double mu = cosine * std::cos(longitude), mu0 = cosine * std::cos(longitude - g);
      sum += brdf.times_mu0(mu0, mu, std::cos(g)) * mu * cosine;
    }
  return sum * 2 * (kPi / 2 / kLatitudes) * (span / kLongitudes);
}

double disc(const Reflectance& reflectance, double wavelength_um, double phase_deg) {
  const Band band(wavelength_um, 1e-3);
  return sphere_reflectance(Brdf(reflectance, &band), phase_deg);
}

// Values that the papers' equations give, computed apart from this code.
TEST(DiscModels, RoloAndLimeByHand) {
  const auto rolo = [](double wavelength_um, double g) {
    return disc_reflectance_at(DiscModel::rolo, wavelength_um, {g});
  };
  EXPECT_NEAR(rolo(0.5491, 7), 0.1006, 5e-5);
  EXPECT_NEAR(rolo(0.5491, 30), 0.0546, 5e-5);
  EXPECT_NEAR(rolo(0.5491, 60), 0.0260, 5e-5);
  EXPECT_NEAR(rolo(0.5491, 90), 0.0105, 5e-5);
  EXPECT_NEAR(rolo(0.5538, 7), 0.0982, 5e-5);
  const auto lime = [](double wavelength_um, const DiscGeometry& at) {
    return disc_reflectance_at(DiscModel::lime, wavelength_um, at);
  };
  EXPECT_NEAR(lime(0.675, {30}), 0.0673, 5e-5);
  EXPECT_NEAR(lime(0.44, {7}), 0.0821, 5e-5);
  EXPECT_NEAR(lime(1.64, {90}), 0.0301, 5e-5);
  // Waxing over waning, and libration.
  EXPECT_NEAR(lime(0.675, {30, 30}) / lime(0.675, {30}), 1.0232, 5e-5);
  EXPECT_NEAR(lime(0.675, {30, -30}) / lime(0.675, {30}), 0.9773, 5e-5);
  EXPECT_NEAR(lime(0.675, {30, 0, 5, -3}) / lime(0.675, {30}), std::exp(5 * -0.00111663802 - 3 * 0.000484391094),
              1e-12);
  EXPECT_TRUE(std::isnan(lime(0.4, {30})));
  EXPECT_TRUE(std::isnan(rolo(2.5, {30})));
}

// Linear between bands.
TEST(DiscModels, BetweenBands) {
  const double a = disc_reflectance_at(DiscModel::lime, 0.5, {20}),
               b = disc_reflectance_at(DiscModel::lime, 0.675, {20});
  EXPECT_NEAR(disc_reflectance_at(DiscModel::lime, 0.57, {20}), a + 0.4 * (b - a), 1e-12);
}

TEST(Moon, ItsDiscIsLimes) {
  for (const double wavelength_um : disc_bands_um(DiscModel::lime))
    for (const double g : {2.0, 3.0, 5.0, 7.0, 10.0, 20.0, 45.0, 70.0, 90.0}) {
      const double lime = disc_reflectance_at(DiscModel::lime, wavelength_um, {g});
      EXPECT_NEAR(moon_reflectance(MoonGround::mean, wavelength_um, g), lime, 1e-12 * lime);
      EXPECT_NEAR(disc(moon(), wavelength_um, g), lime, 1e-3 * lime) << wavelength_um << " um, " << g << " degrees";
    }
}

// Integrals over the sphere, and whole frames of it from so far away that the phase angle is the same all over, to 0.1
// %.
TEST(Moon, DiscsOfASmoothSphereHaveTheClosedForms) {
  const Reflectance seeliger{ReflectanceModel::lommel_seeliger, 1, 1}, lambert{ReflectanceModel::lambert, 1, 1};
  test::TemporaryFolder folder;
  test::write_global_tile(folder / "dem", 2, [](double, double) { return 0.0; });
  const Renderer renderer(test::open_terrain(folder / "dem"), RendererOptions{2, std::size_t{256} << 20});
  constexpr double kDistance_m = 1e10, kRadius_rad = kMoonRadius_m / kDistance_m;
  FrameRequest request;
  request.camera = test::square_camera(384, 2.04 * kRadius_rad / kRadians);
  request.pose = test::looking({kDistance_m, 0, 0}, -Vec3::unit_x(), Vec3::unit_z());
  request.band = Band(0.675, 1e-3);
  request.products = kRadiance, request.accuracy.samples_per_pixel = 4;
  const double pixel_sr = 1 / (request.camera.fx * request.camera.fy);
  for (const Reflectance& reflectance : {seeliger, lambert, moon()})
    for (const double g : {2.0, 15.0, 45.0, 90.0}) {
      const double expected = reflectance.model == ReflectanceModel::moon
                                  ? disc_reflectance_at(DiscModel::lime, 0.675, {g})
                              : reflectance.model == ReflectanceModel::lambert ? lambert_sphere(g)
                                                                               : lommel_seeliger_sphere(g) / 4;
      EXPECT_NEAR(sphere_reflectance(Brdf(reflectance, &*request.band), g), expected, 1e-3 * expected) << g;
      request.reflectance = reflectance;
      request.sun.direction = {std::cos(g * kRadians), std::sin(g * kRadians), 0};
      double light = 0;
      for (const float radiance : renderer.render(request).products.radiance) light += static_cast<double>(radiance);
      const double reflected = light * pixel_sr / (kRadius_rad * kRadius_rad * solar_irradiance_w_m2(*request.band));
      EXPECT_NEAR(reflected, expected, 1e-3 * expected) << static_cast<int>(reflectance.model) << " " << g;
    }
}

TEST(Moon, RolosShapeBeyondLimes) {
  const auto ratio = [](double wavelength_um, double g) {
    return moon_reflectance(MoonGround::mean, wavelength_um, g) /
           disc_reflectance_at(DiscModel::rolo, wavelength_um, {g});
  };
  EXPECT_NEAR(ratio(0.675, 0), ratio(0.675, 2), 1e-9);
  EXPECT_NEAR(ratio(0.675, 97), ratio(0.675, 90), 1e-9);
  // By wavelength: a mean of adjacent bands, which differ by up to 5 %.
  for (const double um : {0.3551, 0.4123, 1.9815, 2.3836})
    EXPECT_NEAR(ratio(um, 30), um < 1 ? ratio(0.4416, 30) : ratio(1.6336, 30), 0.06 * ratio(um, 30)) << um;
}

TEST(Moon, SteadyAndFalling) {
  for (const double um : {0.35, 0.44, 0.6, 1.0, 1.64, 2.3})
    for (double g = 0; g < 149; g += 0.25) {
      const double here = moon_reflectance(MoonGround::mean, um, g);
      EXPECT_GT(here, moon_reflectance(MoonGround::mean, um, g + 0.25)) << g;
      EXPECT_NEAR(here, moon_reflectance(MoonGround::mean, um, g + 1e-7), 1e-6 * here) << g;
    }
  const Brdf brdf(moon());
  for (const double mu0 : {1e-300, 1e-9, 0.5, 1.0})
    for (const double mu : {0.0, 1e-9, 0.5, 1.0})
      for (const double cos_phase : {-1.0, 0.0, 0.7, 1.0}) {
        const double value = brdf.times_mu0(mu0, mu, cos_phase);
        EXPECT_TRUE(std::isfinite(value) && value >= 0) << mu0 << " " << mu << " " << cos_phase;
      }
}

// A band's reflectance is the mean over its sunlight.
TEST(Moon, BandsIntegrate) {
  const Band wide(0.7, 0.6);
  double light = 0, reflected = 0;
  constexpr int kParts = 600;
  for (int i = 0; i < kParts; ++i) {
    const Band part(0.4 + (i + 0.5) * 0.6 / kParts, 0.6 / kParts);
    const double sunlight = solar_irradiance_w_m2(part);
    light += sunlight, reflected += sunlight * moon_reflectance(MoonGround::mean, part.center_um(), 30);
  }
  const double whole = sphere_reflectance(Brdf(moon(), &wide), 30);
  EXPECT_NEAR(whole, reflected / light, 2e-4 * whole);
  EXPECT_NEAR(moonlight_w_m2(MoonGround::mean, wide), reflected, 1e-4 * reflected);
  // All wavelengths.
  const double all = sphere_reflectance(Brdf(moon()), 30);
  EXPECT_GT(all, moon_reflectance(MoonGround::mean, 0.5, 30));
  EXPECT_LT(all, moon_reflectance(MoonGround::mean, 1.02, 30));
}

TEST(Moon, MareAndHighlands) {
  for (const double um : {0.4, 0.6, 0.689, 1.64}) {
    const double mare = disc(moon(MoonGround::mare), um, 30), mean = disc(moon(), um, 30),
                 highlands = disc(moon(MoonGround::highlands), um, 30);
    EXPECT_GT(mare / mean, 0.6);
    EXPECT_LT(mare / mean, 0.9);
    EXPECT_GT(highlands / mean, 1.2);
    EXPECT_LT(highlands / mean, 1.7);
  }
}

TEST(Moon, Trust) {
  const Band within(0.65, 0.2), infrared(2.1, 0.2), far(4, 1);
  EXPECT_NEAR(moon_trust(&within).uncertainty, 0.02, 1e-9);
  EXPECT_NEAR(moon_trust(&within).extrapolated_share, 0, 1e-9);
  EXPECT_NEAR(moon_trust(&infrared).uncertainty, 0.1, 1e-9);
  EXPECT_NEAR(moon_trust(&far).extrapolated_share, 1, 1e-9);
  // Sunlight below 0.35 and above 2.5 um: some 8 %.
  EXPECT_NEAR(moon_trust(nullptr).extrapolated_share, 0.08, 0.02);
}

TEST(Sato2014, ItsTable) {
  const HapkeParameters p = sato2014(SatoRegion::mare, 0.643);
  EXPECT_DOUBLE_EQ(p.w, 0.2545);
  EXPECT_DOUBLE_EQ(p.b, 0.263);
  EXPECT_DOUBLE_EQ(p.c, 0.0811);
  EXPECT_DOUBLE_EQ(p.b0, 1.994);
  EXPECT_DOUBLE_EQ(p.h, 0.0485);
  EXPECT_DOUBLE_EQ(p.theta_bar_deg, 23.657);
  EXPECT_EQ(sato2014(SatoRegion::mare, 1).w, sato2014(SatoRegion::mare, 0.689).w);
}

// I/F of the paper's equation written down here once more: no roughness, whose factor the ISIS tests cover.
TEST(Sato2014, ItsEquation) {
  Reflectance smooth{ReflectanceModel::hapke};
  smooth.hapke = sato2014(SatoRegion::global, 0.643);
  smooth.hapke.theta_bar_deg = 0;
  const HapkeParameters& p = smooth.hapke;
  const double g = 40 * kRadians, mu0 = std::cos(35 * kRadians), mu = std::cos(15 * kRadians);
  const auto lobe = [&](double sign) {
    return (1 - p.b * p.b) / std::pow(1 + sign * 2 * p.b * std::cos(g) + p.b * p.b, 1.5);
  };
  const double phase = (1 + p.c) / 2 * lobe(-1) + (1 - p.c) / 2 * lobe(1);
  const auto h = [&](double x) { return (1 + 2 * x) / (1 + 2 * x * std::sqrt(1 - p.w)); };
  const double factor =
      p.w / 4 * mu0 / (mu0 + mu) * (phase * (1 + p.b0 / (1 + std::tan(g / 2) / p.h)) + h(mu0) * h(mu) - 1);
  EXPECT_NEAR(std::numbers::pi * Brdf(smooth).times_mu0(mu0, mu, std::cos(g)), factor, 1e-12);
}

// Relative to 30 degrees it follows ROLO from 10 to 90 degrees.
TEST(Sato2014, FollowsRolo) {
  Reflectance hapke{ReflectanceModel::hapke};
  hapke.hapke = sato2014(SatoRegion::global, 0.643);
  const auto light = [&](double g) {
    return sphere_reflectance(Brdf(hapke), g) / disc_reflectance_at(DiscModel::rolo, 0.643, {g});
  };
  for (const double g : {10.0, 20.0, 45.0, 60.0, 75.0, 90.0}) EXPECT_NEAR(light(g) / light(30), 1, 0.05) << g;
}

}  // namespace
}  // namespace selenograph::engine
