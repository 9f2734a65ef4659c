// Every reflectance model: the paper's conditions (5) to (7), values by hand and by other tools.
#include "engine/radiometry/brdf.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "engine/radiometry/phase_law.h"
#include "tests/support/reflectance.h"

namespace selenograph::engine {
namespace {

constexpr double kRadians = std::numbers::pi / 180;

Reflectance blinn_phong(double p, double rho = 0.3) {
  Reflectance r{ReflectanceModel::blinn_phong};
  r.shininess = p, r.rho = rho;
  return r;
}
Reflectance lunar_lambert(std::optional<double> weight, double rho = 0.12) {
  Reflectance r{ReflectanceModel::lunar_lambert};
  r.limb_darkening = weight, r.rho = rho;
  return r;
}
Reflectance hapke(const HapkeParameters& parameters) {
  Reflectance r{ReflectanceModel::hapke};
  r.hapke = parameters;
  return r;
}
HapkeParameters henyey_greenstein(double w, double b0, double h, double b, double c, double theta_bar_deg) {
  return {w, b0, h, PhaseFunction::double_henyey_greenstein, b, c, theta_bar_deg};
}
HapkeParameters of_2002(HapkeParameters parameters, double bc0 = 0, double hc = 0.1) {
  parameters.terms = HapkeTerms::terms_2002, parameters.bc0 = bc0, parameters.hc = hc;
  return parameters;
}
Reflectance with_phase(Reflectance reflectance, PhaseLaw law) {
  reflectance.phase = law;
  return reflectance;
}

struct Case {
  std::string name;
  Reflectance reflectance;
  double most;  // of directional-hemispherical reflectance
};
std::vector<Case> cases() {
  std::vector<Case> all{{"lambert", {ReflectanceModel::lambert}, 0.12},
                        {"lommel_seeliger", {ReflectanceModel::lommel_seeliger}, 0.12},
                        {"lunar", {ReflectanceModel::lommel_seeliger_lambert, 0.35}, 0.12},
                        {"lunar_lambert, McEwen", lunar_lambert({}), 4 * 0.12},
                        {"lunar_lambert, L = 1", lunar_lambert(1, 0.25), 1},
                        {"hapke, the Moon", hapke({}), 1},
                        {"hapke, smooth", hapke({.theta_bar_deg = 0}), 1},
                        {"hapke, two lobes", hapke(henyey_greenstein(0.35, 1.9, 0.08, 0.24, 0.3, 23.4)), 1},
                        {"hapke, rough and bright", hapke(henyey_greenstein(0.9, 0.5, 0.3, 0.2, -0.3, 45)), 1}};
  all.push_back({"hapke 2002", hapke(of_2002({}, 0.3, 0.05)), 1});
  all.push_back({"hapke 2002, two lobes", hapke(of_2002(henyey_greenstein(0.6, 1, 0.1, 0.3, 0.5, 30))), 1});
  for (const PhaseLaw law : {PhaseLaw::allen, PhaseLaw::rolo}) {
    all.push_back({"lommel_seeliger, darkening", with_phase({ReflectanceModel::lommel_seeliger}, law), 0.12});
    all.push_back({"lunar, darkening", with_phase({ReflectanceModel::lommel_seeliger_lambert, 0.35}, law), 0.12});
    all.push_back({"lunar_lambert, A(g)", with_phase(lunar_lambert({}), law), 4 * 0.12});
  }
  for (const double p : {0.0, 0.5, 1.0, 10.0, 100.0, 1000.0})
    all.push_back({"blinn_phong " + std::to_string(p), blinn_phong(p), 0.3});
  return all;
}

struct Geometry {
  double mu0, mu, cos_phase;
};
Geometry degrees(double incidence, double emission, double phase) {
  return {std::cos(incidence * kRadians), std::cos(emission * kRadians), std::cos(phase * kRadians)};
}
Geometry azimuth(double mu0, double mu, double cos_azimuth) {
  return {mu0, mu, mu0 * mu + std::sqrt((1 - mu0 * mu0) * (1 - mu * mu)) * cos_azimuth};
}
double f_r(const Brdf& brdf, const Geometry& g) { return brdf(g.mu0, g.mu, g.cos_phase); }
double f_r(const Reflectance& r, const Geometry& g) { return f_r(Brdf(r), g); }
double radiance_factor(const Reflectance& r, const Geometry& g) {
  return std::numbers::pi * Brdf(r).times_mu0(g.mu0, g.mu, g.cos_phase);
}

TEST(Brdf, TheLinearModelsAreTheFastOnes) {
  for (const Reflectance& r : {Reflectance{ReflectanceModel::lambert}, Reflectance{ReflectanceModel::lommel_seeliger},
                               Reflectance{ReflectanceModel::lommel_seeliger_lambert, 0.3, 0.2}}) {
    ASSERT_TRUE(Brdf(r).terms());
    EXPECT_EQ(f_r(r, {0.5, 0.7, 0.1}), test::brdf(r, 0.5, 0.7));
    EXPECT_EQ(direct_radiance(Brdf(r), 1361, 0.5, -0.1, 0.3, 0.5), test::direct_radiance(r, 1361, 0.5, -0.1, 0.5));
  }
  EXPECT_TRUE(Brdf(lunar_lambert(0.3)).terms());
  EXPECT_FALSE(Brdf(with_phase({ReflectanceModel::lommel_seeliger}, PhaseLaw::rolo)).terms());
  EXPECT_FALSE(Brdf(blinn_phong(1)).terms());
  EXPECT_FALSE(Brdf(lunar_lambert({})).terms());
  EXPECT_FALSE(Brdf(hapke({})).terms());
}

// Eq. (11).
TEST(Brdf, BlinnPhongByHand) {
  EXPECT_NEAR(f_r(blinn_phong(0), degrees(20, 70, 50)), 0.3 / std::numbers::pi,
              1e-15);  // "becomes Equation (4) for p = 0"
  // Sun and camera 30 degrees to either side: the halfway vector is the normal. (14 * 12) / (10 + 1/32) = 16.747664...
  EXPECT_NEAR(f_r(blinn_phong(10), degrees(30, 30, 60)), 0.3 / (8 * std::numbers::pi) * 16.747663551401868, 1e-13);
  // Both at 40 degrees in the same place: halfway there, too.
  EXPECT_NEAR(f_r(blinn_phong(10), degrees(40, 40, 0)),
              0.3 / (8 * std::numbers::pi) * 16.747663551401868 * std::pow(std::cos(40 * kRadians), 10), 1e-13);
  // Opposite each other on the horizon: no halfway vector, nothing reflected.
  EXPECT_EQ(Brdf(blinn_phong(10)).times_mu0(0, 0, -1), 0);
}

// ISIS 3 photomet (public domain), unit tests of its LunarLambert: divided by the value at mu0 = mu = 1.
TEST(Brdf, LunarLambertAgreesWithIsis) {
  for (const auto& [weight, expected] : {std::pair{1.0, 0.898979}, {0.0, 0.707107}, {0.5, 0.803043}}) {
    const Reflectance r = lunar_lambert(weight);
    EXPECT_NEAR(radiance_factor(r, degrees(45, 30, 60)) / radiance_factor(r, degrees(0, 0, 0)), expected, 1e-6);
  }
  EXPECT_NEAR(radiance_factor(lunar_lambert(0.3), degrees(0, 0, 0)), 0.12, 1e-15);  // rho is a normal albedo
}

// LunarLambertMcEwen there: L(30) = 1 - 0.57 + 0.2178 - 0.03942.
TEST(Brdf, McEwensWeightFollowsThePhase) {
  const Geometry g = degrees(45, 30, 30);
  EXPECT_NEAR(f_r(lunar_lambert({}), g), f_r(lunar_lambert(0.60838), g), 1e-12);  // of a table
  const Geometry opposition = degrees(50, 50, 0);
  EXPECT_NEAR(f_r(lunar_lambert({}), opposition), f_r(lunar_lambert(1), opposition), 1e-14);
  const Geometry forward = degrees(80, 80, 160);  // the polynomial is below 0 beyond 105 degrees
  EXPECT_EQ(f_r(lunar_lambert({}), forward), f_r(lunar_lambert(0), forward));
}

// Radiance factors of ISIS 3 photomet, unit tests of its HapkeHen and HapkeLeg: (phase, incidence, emission) of (0, 0,
// 0) and (60, 45, 30) degrees. Its Hg2 is (1 + c) / 2 here.
TEST(Brdf, HapkeAgreesWithIsis) {
  const Reflectance isotropic = hapke(henyey_greenstein(0.5, 0, 1, 0, 0, 0)),
                    rough = hapke(henyey_greenstein(0.52, 1, 1, 0.213, 1, 30)),
                    legendre = hapke({0.52, 1, 1, PhaseFunction::legendre, 0, 0, 30});
  EXPECT_NEAR(radiance_factor(isotropic, degrees(0, 0, 0)), 0.09650974233026809, 1e-15);
  EXPECT_NEAR(radiance_factor(isotropic, degrees(45, 30, 60)), 0.08328830919316457, 1e-15);
  EXPECT_NEAR(radiance_factor(rough, degrees(0, 0, 0)), 0.28604794646042775, 1e-14);
  EXPECT_NEAR(radiance_factor(rough, degrees(45, 30, 60)), 0.1341996835824601, 1e-14);
  EXPECT_NEAR(radiance_factor(legendre, degrees(45, 30, 60)), 0.11152494713005053, 1e-14);
}

// What Helfenstein & Veverka's Moon looks like: normal albedo around 0.13, and a surge of tens of percent in the last
// seven degrees.
TEST(Brdf, TheMoonsOppositionSurge) {
  const Reflectance moon = hapke({});
  const double full = radiance_factor(moon, degrees(0, 0, 0)), seven = radiance_factor(moon, degrees(7, 0, 7)),
               ninety = radiance_factor(moon, degrees(60, 30, 90));
  EXPECT_GT(full, 0.1);
  EXPECT_LT(full, 0.16);
  EXPECT_GT(full / seven, 1.25);
  EXPECT_LT(full / seven, 1.6);
  EXPECT_LT(ninety, 0.2 * full);
}

// A uniform sphere's light at a phase angle over pi: what a camera far away sums up.
double sphere_light(const Reflectance& reflectance, double phase_deg) {
  constexpr int kSteps = 800;
  const Brdf brdf(reflectance);
  const double g = phase_deg * kRadians, sx = std::sin(g), sz = std::cos(g);
  double sum = 0;
  // Over the lit part of the visible disc by longitude from the camera and sine of latitude: dA mu.
  const double from = g - std::numbers::pi / 2, to = std::numbers::pi / 2;
  for (int i = 0; i < kSteps; ++i) {
    const double longitude = from + (to - from) * (i + 0.5) / kSteps;
    for (int k = 0; k < kSteps; ++k) {
      const double latitude = std::numbers::pi / 2 * (k + 0.5) / kSteps, ring = std::cos(latitude);
      const double x = ring * std::sin(longitude), z = ring * std::cos(longitude);
      sum += brdf.times_mu0(x * sx + z * sz, z, sz) * z * ring;
    }
  }
  return sum * 2 * (to - from) / kSteps * (std::numbers::pi / 2) / kSteps;
}

TEST(PhaseLaw, TheClosedFormsOfASpheresLight) {
  const Reflectance seeliger{ReflectanceModel::lommel_seeliger, 1, 4}, lambert{ReflectanceModel::lambert, 1, 1};
  for (const double g : {0.0, 10.0, 45.0, 90.0, 135.0, 170.0}) {
    EXPECT_NEAR(sphere_light(seeliger, g), lommel_seeliger_sphere(g), 2e-5) << g;
    EXPECT_NEAR(sphere_light(lambert, g), lambert_sphere(g), 2e-5) << g;
  }
}

TEST(PhaseLaw, ASpheresLightFollowsTheMoons) {
  for (const PhaseLaw law : {PhaseLaw::allen, PhaseLaw::rolo})
    for (const Reflectance& model :
         {Reflectance{ReflectanceModel::lommel_seeliger}, Reflectance{ReflectanceModel::lommel_seeliger_lambert, 0.35},
          lunar_lambert({}), lunar_lambert(0.4)}) {
      const Reflectance r = with_phase(model, law);
      const double full = sphere_light(r, 0);
      EXPECT_NEAR(full, sphere_light(model, 0), 1e-9) << "f(0) = 1";
      for (const double g : {2.0, 7.0, 30.0, 60.0, 97.0, 120.0, 150.0})
        EXPECT_NEAR(sphere_light(r, g) / full, moon_light(law, g), 1e-4 * moon_light(law, g)) << g;
    }
}

// Allen's magnitudes are written down here once more; ROLO's reflectance at 7 and 90 degrees: by hand from its table.
TEST(PhaseLaw, TheMoonsLight) {
  EXPECT_NEAR(moon_light(PhaseLaw::allen, 90), std::pow(10, -0.4 * (2.34 + 0.26244)), 1e-12);
  EXPECT_EQ(moon_light(PhaseLaw::allen, 170), moon_light(PhaseLaw::allen, 150));
  EXPECT_NEAR(moon_light(PhaseLaw::rolo, 7), 0.0982 / 0.1555, 5e-4);
  EXPECT_NEAR(moon_light(PhaseLaw::rolo, 90), 0.0102 / 0.1555, 5e-4);
  EXPECT_NEAR(moon_light(PhaseLaw::rolo, 0), 1, 1e-14);
  for (const PhaseLaw law : {PhaseLaw::allen, PhaseLaw::rolo})
    for (double g = 0; g < 149; g += 0.5) {
      EXPECT_GT(moon_light(law, g), moon_light(law, g + 0.5)) << g;
      EXPECT_NEAR(moon_light(law, g), moon_light(law, g + 1e-7), 1e-7) << g;
    }
}

// What exposures are planned with: both normal albedos the same, the Sun at g from the camera's zenith.
TEST(PhaseLaw, LommelSeeligerDarkensAsHapkeDoes) {
  const Reflectance moon = hapke({}), plain{ReflectanceModel::lommel_seeliger};
  const Reflectance darkening = with_phase(plain, PhaseLaw::rolo);
  const double normal = radiance_factor(moon, degrees(2, 0, 2)) / radiance_factor(darkening, degrees(2, 0, 2));
  double worst = 1, worst_plain = 1;
  for (const double g : {5.0, 10.0, 20.0, 30.0, 45.0, 60.0, 75.0}) {
    const Geometry at = degrees(g, 0, g);
    const double ratio = normal * radiance_factor(darkening, at) / radiance_factor(moon, at),
                 before = normal * radiance_factor(plain, at) / radiance_factor(moon, at);
    worst = std::max({worst, ratio, 1 / ratio}), worst_plain = std::max({worst_plain, before, 1 / before});
  }
  EXPECT_LT(worst, 1.35);
  EXPECT_GT(worst_plain, 3);
}

// P(x): the mean of p over the directions below the surface, for light from a direction with cosine x.
TEST(Hapke, MeansOverAHemisphere) {
  for (const HapkeParameters& k :
       {HapkeParameters{}, henyey_greenstein(0.2, 0, 1, 0.4, 0.3, 0), henyey_greenstein(0.2, 0, 1, 0.7, 0.9, 0)}) {
    const HemisphereMeans means(k);
    const auto by_hand = [&](double x) {
      constexpr int kSteps = 400;
      double sum = 0;
      for (int i = 0; i < kSteps; ++i)
        for (int j = 0; j < kSteps; ++j) {
          const double down = -(i + 0.5) / kSteps, turn = std::cos(std::numbers::pi * (j + 0.5) / kSteps);
          sum += phase_function(k, x * down + std::sqrt((1 - x * x) * (1 - down * down)) * turn);
        }
      return sum / kSteps / kSteps;
    };
    double over = 0;
    for (const double x : {0.0, 0.3, 0.6, 0.9, 1.0}) EXPECT_NEAR(means.at(x), by_hand(x), 2e-3) << x;
    // From below: P(-x), over x.
    for (int i = 0; i < 50; ++i) over += by_hand(-(i + 0.5) / 50) / 50;
    EXPECT_NEAR(means.mean, over, 2e-3);
  }
}

// With isotropic particles the terms of 2002 are H H - 1, with his better H: at w = 1 Chandrasekhar's values.
TEST(Hapke, TermsOf2002) {
  const auto h_squared = [](const HapkeParameters& k, double x) {
    return radiance_factor(hapke(k), azimuth(x, x, 1)) * 4 / k.w * 2;  // w/4 x/(2 x) (1 + H H - 1)
  };
  HapkeParameters white = henyey_greenstein(1, 0, 1, 0, 0, 0);
  double off = 0, off_before = 0;
  // Chandrasekhar, Radiative Transfer (1960), table XI: H(0.2), H(0.5), H(1) for w = 1.
  for (const auto& [x, h] : {std::pair{0.2, 1.4503}, {0.5, 2.0128}, {1.0, 2.9078}}) {
    EXPECT_NEAR(std::sqrt(h_squared(of_2002(white), x)), h, 0.011 * h) << x;
    off += std::abs(std::sqrt(h_squared(of_2002(white), x)) - h);
    off_before += std::abs(std::sqrt(h_squared(white, x)) - h);
  }
  EXPECT_LT(off, off_before / 2);
  // Coherent backscatter, (1 + (1 - e^-z) / z) / (2 (1 + z)^2): all of it at z = 0.
  const HapkeParameters dark = of_2002({}), surge = of_2002({}, 0.5, 0.05);
  EXPECT_NEAR(f_r(hapke(surge), degrees(0, 0, 0)) / f_r(hapke(dark), degrees(0, 0, 0)), 1.5, 1e-7);
  const double g = 2 * std::atan(0.05) / kRadians;  // z = 1
  EXPECT_NEAR(f_r(hapke(surge), degrees(g, 0, g)) / f_r(hapke(dark), degrees(g, 0, g)),
              1 + 0.5 * (2 - std::exp(-1)) / 8, 1e-9);
}

// Eq. (38) of 2002 written down once more.
TEST(Hapke, MultipleScatteringOf2002ByHand) {
  for (const HapkeParameters& parameters :
       {HapkeParameters{}, henyey_greenstein(0.6, 1, 0.1, 0.45, 0.3, 0), henyey_greenstein(0.9, 1, 0.1, 0.8, 0.4, 0)}) {
    HapkeParameters k = of_2002(parameters);
    k.theta_bar_deg = 0;
    const HemisphereMeans p(k);
    const double root = std::sqrt(1 - k.w), r0 = (1 - root) / (1 + root);
    const auto h = [&](double x) { return 1 / (1 - k.w * x * (r0 + (1 - 2 * r0 * x) / 2 * std::log((1 + x) / x))); };
    for (const Geometry& g : {degrees(20, 50, 60), degrees(70, 10, 65), degrees(40, 40, 3), degrees(80, 75, 140)}) {
      const double tan_half = std::tan(std::acos(g.cos_phase) / 2);
      const double in = h(g.mu0) - 1, out = h(g.mu) - 1;
      const double expected = k.w / (4 * std::numbers::pi) / (g.mu0 + g.mu) *
                              ((1 + k.b0 / (1 + tan_half / k.h)) * phase_function(k, g.cos_phase) + p.at(g.mu0) * out +
                               p.at(g.mu) * in + p.mean * in * out);
      EXPECT_NEAR(f_r(hapke(k), g), expected, (k.b > 0.5 ? 1e-3 : 1e-5) * expected);
    }
  }
}

// A packet's values are a lane's.
TEST(Brdf, APacketIsItsLanes) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> cosine(1e-6, 1), around(-1, 1), weight(0, 1);
  for (const auto& [name, r, most] : cases()) {
    const Brdf brdf(r);
    for (int n = 0; n < 500; ++n) {
      double mu0[kPacket], mu[kPacket], cos_phase[kPacket], albedo[kPacket], out[kPacket];
      for (int i = 0; i < kPacket; ++i) {
        const Geometry g =
            azimuth(n == 0 ? 1 : cosine(random), i == 0 ? 0 : cosine(random), i == 1 ? 1 : around(random));
        mu0[i] = g.mu0, mu[i] = g.mu, cos_phase[i] = g.cos_phase, albedo[i] = weight(random);
      }
      brdf.times_mu0(mu0, mu, cos_phase, nullptr, out);
      for (int i = 0; i < kPacket; ++i) {
        const double expected = brdf.times_mu0(mu0[i], mu[i], cos_phase[i]);
        EXPECT_NEAR(out[i], expected, 1e-6 * expected + 1e-15)
            << name << ' ' << mu0[i] << ' ' << mu[i] << ' ' << cos_phase[i];
      }
      if (r.model != ReflectanceModel::hapke) continue;
      brdf.times_mu0(mu0, mu, cos_phase, albedo, out);
      for (int i = 0; i < kPacket; ++i) {
        Reflectance here = r;
        here.hapke.w = albedo[i];
        const double expected = Brdf(here).times_mu0(mu0[i], mu[i], cos_phase[i]);
        EXPECT_NEAR(out[i], expected, 1e-6 * expected + 1e-15) << name << ' ' << albedo[i];
      }
    }
  }
}

// The integral of f_r mu over the hemisphere; midpoints in mu^2 / 2 and azimuth.
double directional_hemispherical(const Reflectance& reflectance, double mu0, int steps, int turns) {
  const Brdf brdf(reflectance);
  double sum = 0;
  for (int i = 0; i < steps; ++i) {
    const double mu = std::sqrt((i + 0.5) / steps);
    for (int k = 0; k < turns; ++k) {
      const Geometry g = azimuth(mu0, mu, std::cos(std::numbers::pi * (k + 0.5) / turns));
      sum += brdf(g.mu0, g.mu, g.cos_phase);
    }
  }
  return std::numbers::pi * sum / steps / turns;
}

// Eq. (11)'s factor is what makes it rho for a Sun in the zenith.
TEST(Brdf, BlinnPhongReflectsRhoFromTheZenith) {
  for (const double p : {0.0, 1.0, 10.0, 100.0})
    EXPECT_NEAR(directional_hemispherical(blinn_phong(p), 1, 1000, 400), 0.3, 1e-4) << p;
}

TEST(Brdf, DarkWithoutSun) {
  for (const auto& [name, r, most] : cases()) {
    EXPECT_EQ(direct_radiance(Brdf(r), 1361, 0, 0.5, 0.1, 1), 0) << name;
    EXPECT_EQ(direct_radiance(Brdf(r), 1361, -0.1, 0, 0.1, 1), 0) << name;
    EXPECT_EQ(direct_radiance(Brdf(r), 1361, std::nan(""), 0.5, 0.1, 1), 0) << name;
    EXPECT_EQ(direct_radiance(Brdf(r), 1361, 0.5, 0.5, 0.1, 0), 0) << name;
    EXPECT_GE(direct_radiance(Brdf(r), 1361, 0.5, -0.01, 0.1, 1), 0) << name;
  }
}

}  // namespace
}  // namespace selenograph::engine
