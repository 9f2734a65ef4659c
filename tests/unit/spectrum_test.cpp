// Planck's law, the Sun's spectrum and integrals over bands: against closed forms and published totals.
#include "engine/radiometry/spectrum.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "dem/base/error.h"
#include "engine/radiometry/photometry.h"
#include "engine/radiometry/solar_spectrum.h"

namespace selenograph::engine {
namespace {

constexpr double kStefanBoltzmann = 5.670374419e-8;  // CODATA 2018, W m-2 K-4

// Radiance of a blackbody from 0 to a wavelength, by the series of the fractional function (Chang & Rhee, Int. Comm.
// Heat Mass Transfer 11, 451, 1984): sigma T^4 / pi 15 / pi^4 sum exp(-n x) / n (x^3 + 3 x^2 / n + 6 x / n^2 + 6 /
// n^3).
double below(double wavelength_um, double temperature_k) {
  const double x = 14387.768775039337 / (wavelength_um * temperature_k);  // c2 = h c / k, um K
  double sum = 0;
  for (int n = 1; n < 2000; ++n) {
    const double term =
        std::exp(-n * x) / n * (x * x * x + 3 * x * x / n + 6 * x / (double(n) * n) + 6 / std::pow(n, 3));
    sum += term;
    if (term < 1e-18 * sum) break;
  }
  return kStefanBoltzmann * std::pow(temperature_k, 4) / std::numbers::pi * 15 / std::pow(std::numbers::pi, 4) * sum;
}

// With 30 digits.
TEST(Planck, Values) {
  EXPECT_NEAR(planck_w_m2_sr_um(10, 300), 9.924033330070, 1e-11);
  EXPECT_NEAR(planck_w_m2_sr_um(0.5, 5772), 26238540.5685958, 1e-5);
  EXPECT_NEAR(planck_w_m2_sr_um(8, 700), 301.492035289165, 1e-10);
  EXPECT_EQ(planck_w_m2_sr_um(10, 0), 0);
  EXPECT_EQ(planck_w_m2_sr_um(0.1, 3), 0);  // exp overflows: nothing is emitted
  // Wien: the largest at 2897.771955 um K.
  const double peak = 2897.771955 / 350;
  EXPECT_GT(planck_w_m2_sr_um(peak, 350), planck_w_m2_sr_um(peak * 0.999, 350));
  EXPECT_GT(planck_w_m2_sr_um(peak, 350), planck_w_m2_sr_um(peak * 1.001, 350));
}

TEST(Planck, BandsAgreeWithTheClosedForm) {
  for (const double kelvin : {40.0, 100.0, 290.0, 700.0, 5772.0})
    for (const auto& [from, to] : {std::pair{7.0, 14.0}, {0.4, 0.7}, {8.0, 8.09}, {0.3, 100.0}, {30.0, 30.001}}) {
      const double expected = below(to, kelvin) - below(from, kelvin);
      // The difference of two numbers that are nearly the same has lost digits itself.
      const double lost = 1e-14 * below(to, kelvin);
      EXPECT_NEAR(planck_w_m2_sr(Band((from + to) / 2, to - from), kelvin), expected, 1e-9 * expected + lost)
          << kelvin << ' ' << from << ' ' << to;
    }
}

// Beyond the last wavelength there are 15 / pi^4 x^3 / 3 = 5.7e-6 of it.
TEST(Planck, AllWavelengthsAreStefanAndBoltzmann) {
  for (const double kelvin : {100.0, 300.0, 1000.0}) {
    const double expected = kStefanBoltzmann * std::pow(kelvin, 4) / std::numbers::pi;
    EXPECT_NEAR(planck_w_m2_sr(Band(500.05 * 300 / kelvin, 999.9 * 300 / kelvin), kelvin), expected, 6e-6 * expected);
    for (const double first_um : {1e-7, 1e-300}) {
      const Band from_nothing(std::vector<ResponsePoint>{{first_um, 1}, {1000 * 300 / kelvin, 1}});
      EXPECT_NEAR(planck_w_m2_sr(from_nothing, kelvin), expected, 1e-3 * expected) << first_um;
    }
  }
}

TEST(SolarSpectrum, TheTotalIsTheSolarConstant) {
  double total = 0;
  for (std::size_t i = 0; i + 1 < astm_e490().size(); ++i) {
    const SpectralSample &a = astm_e490()[i], &b = astm_e490()[i + 1];
    ASSERT_LT(a.wavelength_um, b.wavelength_um);
    ASSERT_GT(b.irradiance_w_m2_um, 0);
    total += (b.wavelength_um - a.wavelength_um) * (a.irradiance_w_m2_um + b.irradiance_w_m2_um) / 2;
  }
  EXPECT_NEAR(total, 1366.1, 0.05);  // as published
  EXPECT_NEAR(total, kAstmE490Total_w_m2, 1e-3);
  EXPECT_NEAR(solar_irradiance_w_m2(Band(500.05975, 999.8805)), kSolarConstant_w_m2, 1e-3);
}

// Wehrli (1985), the WMO's reference, an independent spectrum, has 1367 W m-2 and these shares (Kopp & Lean's total):
// visible 0.4 to 0.7 um 38.8 %, below 0.4 um 7.9 to 8.3 %. A blackbody of 5772 K with the Sun's solid angle is within 4
// % in broad bands.
TEST(SolarSpectrum, BandsAreThoseOfOtherSpectra) {
  EXPECT_NEAR(solar_irradiance_w_m2(Band(0.55, 0.3)) / kSolarConstant_w_m2, 0.388, 0.004);
  EXPECT_NEAR(solar_irradiance_w_m2(Band(0.25, 0.2999)) / kSolarConstant_w_m2, 0.081, 0.004);
  const double solid_angle = std::numbers::pi * std::pow(6.957e8 / 149597870700.0, 2);  // IAU 2015 B3 radius at 1 au
  for (const auto& [from, to] : {std::pair{0.45, 0.9}, {0.9, 1.6}, {1.6, 4.0}, {0.2, 20.0}}) {
    const Band band((from + to) / 2, to - from);
    EXPECT_NEAR(solar_irradiance_w_m2(band) / (planck_w_m2_sr(band, 5772) * solid_angle), 1, from < 0.9 ? 0.04 : 0.12)
        << from;
  }
}

TEST(Band, MeasuresItsResponse) {
  const Band box(0.65, 0.1);
  EXPECT_NEAR(box.center_um(), 0.65, 1e-15);
  EXPECT_NEAR(box.width_um(), 0.1, 1e-15);
  const Band triangle({{0.5, 0}, {0.6, 1}, {0.8, 0}});
  EXPECT_NEAR(triangle.width_um(), 0.15, 1e-15);
  EXPECT_NEAR(triangle.center_um(), (0.5 + 0.6 + 0.8) / 3, 1e-15);
  EXPECT_EQ(solar_irradiance_w_m2_um(0.1), 0);
  EXPECT_EQ(solar_irradiance_w_m2_um(1001), 0);
}

// The same by brute force, a million steps.
TEST(Band, ResponseCurvesAreIntegratedExactly) {
  const Band band({{0.41234, 0.2}, {0.5, 1}, {0.612345, 0.7}, {0.9, 0}});
  double sun = 0, planck = 0;
  constexpr int kSteps = 1000000;
  const auto& curve = band.response();
  for (int i = 0; i < kSteps; ++i) {
    const double step = (0.9 - 0.41234) / kSteps, w = 0.41234 + (i + 0.5) * step;
    std::size_t k = 0;
    while (k + 2 < curve.size() && w > curve[k + 1].wavelength_um) ++k;
    const double r = curve[k].response + (curve[k + 1].response - curve[k].response) * (w - curve[k].wavelength_um) /
                                             (curve[k + 1].wavelength_um - curve[k].wavelength_um);
    sun += r * solar_irradiance_w_m2_um(w) * step, planck += r * planck_w_m2_sr_um(w, 2000) * step;
  }
  EXPECT_NEAR(solar_irradiance_w_m2(band), sun, 1e-8 * sun);
  EXPECT_NEAR(planck_w_m2_sr(band, 2000), planck, 1e-9 * planck);
}

TEST(Band, RejectsInvalidBands) {
  EXPECT_THROW(Band(0.5, 0), ImpossibleRequest);
  EXPECT_THROW(Band(0.5, 1), ImpossibleRequest);
  EXPECT_THROW(Band(std::nan(""), 0.1), ImpossibleRequest);
  EXPECT_THROW(Band(1, 1e-20), ImpossibleRequest);  // no wavelength in between
  EXPECT_THROW(Band({{0.5, 1}}), ImpossibleRequest);
  EXPECT_THROW(Band({{0.5, 1}, {0.5, 1}}), ImpossibleRequest);
  EXPECT_THROW(Band({{0, 1}, {0.5, 1}}), ImpossibleRequest);
  EXPECT_THROW(Band({{0.4, 1}, {0.5, -1}}), ImpossibleRequest);
  EXPECT_THROW(Band({{0.4, 0}, {0.5, 0}}), ImpossibleRequest);
}

// Photons of a spectrum in a band, times h c: the integral of response efficiency lambda L, by midpoints.
template <typename Spectrum>
double photons(const Band& band, const std::vector<ResponsePoint>& efficiency, const Spectrum& spectrum) {
  const double from = band.response().front().wavelength_um, to = band.response().back().wavelength_um;
  constexpr int kSteps = 400000;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double w = from + (to - from) * (i + 0.5) / kSteps;
    double eta = 1;
    if (!efficiency.empty()) {
      eta = 0;
      for (std::size_t k = 0; k + 1 < efficiency.size(); ++k) {
        const ResponsePoint &a = efficiency[k], &b = efficiency[k + 1];
        if (w >= a.wavelength_um && w < b.wavelength_um)
          eta = a.response + (b.response - a.response) * (w - a.wavelength_um) / (b.wavelength_um - a.wavelength_um);
      }
    }
    sum += band.response_at(w) * eta * w * spectrum(w) * (to - from) / kSteps;
  }
  return sum;
}

double sunlight_wavelength_um(const Band& band, const std::vector<ResponsePoint>& efficiency) {
  return photon_wavelength_um(band, efficiency, solar_irradiance_w_m2);
}

// Eq. (8) counts a wide band's photons at its center: 4.9 % too many of sunlight in 0.4 to 0.9 um, 10 % too few of 300
// K in 3 to 5 um.
TEST(Photons, AreCountedOverTheBand) {
  const auto sunlight = [](double w) { return solar_irradiance_w_m2_um(w); };
  const auto warm = [](double w) { return planck_w_m2_sr_um(w, 300); };
  const std::vector<ResponsePoint> silicon{{0.35, 0.1}, {0.6, 0.7}, {0.85, 0.4}, {1.0, 0.05}};
  for (const Band& band :
       {Band(0.65, 0.5), Band(0.65, 0.01), Band({{0.4, 0}, {0.55, 1}, {0.9, 0.3}, {1.1, 0}}), Band(4, 2)})
    for (const auto& efficiency : {std::vector<ResponsePoint>{}, silicon}) {
      if (band.center_um() > 1 && !efficiency.empty()) continue;
      const Band counted = in_photons(band, efficiency);
      const double sun = photons(band, efficiency, sunlight), heat = photons(band, efficiency, warm);
      EXPECT_NEAR(band.center_um() * solar_irradiance_w_m2(counted) / sun, 1, 3e-5) << band.center_um();
      EXPECT_NEAR(sunlight_wavelength_um(band, efficiency) * solar_irradiance_w_m2(band) / sun, 1, 3e-5);
      EXPECT_NEAR(band.center_um() * planck_w_m2_sr(counted, 300) / heat, 1, 3e-5);
    }
  EXPECT_NEAR(0.65 / sunlight_wavelength_um(Band(0.65, 0.5), {}), 1.049, 0.002);
  EXPECT_NEAR(planck_w_m2_sr(in_photons(Band(4, 2), {}), 300) / planck_w_m2_sr(Band(4, 2), 300), 1.11, 0.01);
}

TEST(Photons, NarrowBandMatchesThePaper) {
  EXPECT_NEAR(sunlight_wavelength_um(Band(0.65, 1e-3), {}), 0.65, 1e-5);
  EXPECT_NEAR(sunlight_wavelength_um(Band(0.65, 1e-3), {{0.4, 0.5}, {0.9, 0.5}}), 0.325, 1e-5);
}

// Steps at an efficiency's ends, and none of the band left.
TEST(Photons, EfficiencyIsNothingOutsideOfItsCurve) {
  const Band band(0.65, 0.5);
  const std::vector<ResponsePoint> middle{{0.6, 1}, {0.7, 1}};
  EXPECT_NEAR(solar_irradiance_w_m2(in_photons(band, middle)) * 0.65,
              solar_irradiance_w_m2(Band(0.65, 0.1)) * sunlight_wavelength_um(Band(0.65, 0.1), {}), 1e-3);
  EXPECT_THROW(in_photons(band, {{2, 1}, {3, 1}}), ImpossibleRequest);
}

// A curve may end where the band does, of which rounding makes two places.
TEST(Photons, AnEfficiencyMayEndWhereTheBandEnds) {
  for (const double center_um : {0.45, 0.55, 0.6, 0.7, 0.85, 0.95})
    for (const double width_um : {0.02, 0.1, 0.2, 0.3, 0.4}) {
      const auto ends = [](double um) { return std::round(um * 1e4) / 1e4; };
      const double first = ends(center_um - width_um / 2), last = ends(center_um + width_um / 2);
      const Band band(center_um, width_um);
      const std::vector<ResponsePoint> whole{{first, 0.3}, {last, 0.5}};
      const double share = 0.2 / (last - first) * 1e-3;
      const std::vector<ResponsePoint> wider{{first - 1e-3, 0.3 - share}, {last + 1e-3, 0.5 + share}};
      EXPECT_NEAR(in_photons(band, whole).width_um() / in_photons(band, wider).width_um(), 1, 1e-6) << center_um;
    }
}

}  // namespace
}  // namespace selenograph::engine
