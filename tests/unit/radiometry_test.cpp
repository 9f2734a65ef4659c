// Equations (1) to (3): which components a request has, and how large they are.
#include "engine/radiometry/radiometry.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <numbers>

#include "dem/base/error.h"
#include "engine/radiometry/atmosphere.h"
#include "engine/radiometry/photometry.h"
#include "tests/support/shared_data.h"

namespace selenograph::engine {
namespace {

using test::TemporaryFolder;
using Names = std::vector<std::string_view>;

TEST(RadianceTerms, MoonHasOnlyTheDirectTerm) {
  FrameRequest request;
  request.sun.distance_au = 1.02;
  const RadianceTerms terms = radiance_terms(request);
  EXPECT_DOUBLE_EQ(terms.direct_w_m2, 1361 / (1.02 * 1.02));
  EXPECT_EQ(terms.names(), Names{"direct"});
  EXPECT_EQ(terms.base_w_m2_sr(), 0);
}

// Eq. (3).
TEST(RadianceTerms, AWarmSurfaceEmits) {
  FrameRequest request;
  request.reflectance.rho = 0.2;
  request.temperature_k = 390;
  const RadianceTerms all = radiance_terms(request);
  EXPECT_EQ(all.names(), (Names{"direct", "emitted"}));
  // 5.670374419e-8 * 390^4 / pi = 417.568..., of which 80 %
  EXPECT_NEAR(all.base_w_m2_sr(), 0.8 * 5.670374419e-8 * std::pow(390.0, 4) / std::numbers::pi, 1e-10);
  request.band = Band(10, 0.02);
  EXPECT_NEAR(radiance_terms(request).base_w_m2_sr(), 0.8 * planck_w_m2_sr_um(10, 390) * 0.02, 1e-7);
  request.reflectance.rho = 1;  // a perfect mirror emits nothing
  EXPECT_EQ(radiance_terms(request).base_w_m2_sr(), 0);
}

// Eqs. (1) to (3) with everything in them: constants over wavelength make all integrals products.
TEST(RadianceTerms, AtmosphereAddsAndAttenuates) {
  FrameRequest request;
  request.sun.distance_au = 2;
  request.reflectance.rho = 0.3;
  request.temperature_k = 290;
  request.band = Band(10, 0.5);
  request.atmosphere = std::make_shared<const Atmosphere>(
      std::vector<AtmosphereRow>{{9, 0.6, 8, 0.4, 0.2, 3}, {11, 0.6, 8, 0.4, 0.2, 3}});
  const RadianceTerms terms = radiance_terms(request);
  EXPECT_EQ(terms.names(), (Names{"direct", "indirect", "scattered", "emitted", "thermal_path"}));
  EXPECT_NEAR(terms.direct_w_m2, 8 * 0.6 * 0.5 / 4, 1e-14);
  EXPECT_NEAR(*terms.indirect, 0.4 * 0.5 / 4, 1e-15);
  EXPECT_NEAR(*terms.scattered, 0.2 * 0.5 / 4, 1e-15);
  EXPECT_NEAR(*terms.thermal_path, 3 * 0.5, 1e-14);  // its own light
  EXPECT_NEAR(*terms.emitted, 0.7 * 0.6 * planck_w_m2_sr(Band(10, 0.5), 290), 1e-10);
  request.temperature_k = 0;
  EXPECT_EQ(radiance_terms(request).names(), (Names{"direct", "indirect", "scattered", "thermal_path"}));
  request.band = Band(8.9, 0.5);
  EXPECT_THROW(radiance_terms(request), ImpossibleRequest);
  request.band.reset();
  EXPECT_THROW(radiance_terms(request), ImpossibleRequest);
}

// Three linear functions at once: by brute force.
TEST(Atmosphere, ProductsAreIntegratedExactly) {
  const Atmosphere atmosphere({{0.4, 0.2, 1700, 1, 2, 0}, {0.55, 0.9, 1900, 3, 1, 0.5}, {0.9, 0.5, 900, 0.5, 0.1, 2}});
  const Band band({{0.45, 0.1}, {0.6, 1}, {0.8, 0}});
  const Atmosphere::InBand sums = atmosphere.over(band, 3000);
  double direct = 0, scattered = 0, emitted = 0;
  constexpr int kSteps = 400000;
  for (int i = 0; i < kSteps; ++i) {
    const double step = 0.35 / kSteps, w = 0.45 + (i + 0.5) * step, r = band.response_at(w);
    const bool low = w < 0.55;
    const double share = low ? (w - 0.4) / 0.15 : (w - 0.55) / 0.35;
    const auto mix = [&](double a, double b, double c) { return low ? a + share * (b - a) : b + share * (c - b); };
    const double tau = mix(0.2, 0.9, 0.5);
    direct += r * tau * mix(1700, 1900, 900) * step, scattered += r * mix(2, 1, 0.1) * step;
    emitted += r * tau * planck_w_m2_sr_um(w, 3000) * step;
  }
  EXPECT_NEAR(sums.direct_w_m2, direct, 1e-8 * direct);
  EXPECT_NEAR(sums.scattered_w_m2_sr, scattered, 1e-8 * scattered);
  EXPECT_NEAR(sums.emitted_w_m2_sr, emitted, 1e-8 * emitted);
}

// Of a band's center and width rounding makes an end beyond that of the table.
TEST(Atmosphere, HoldsABandThatEndsWhereItDoes) {
  const Atmosphere atmosphere({{0.35, 0.2, 1700, 1, 2, 0}, {1.03, 0.5, 900, 0.5, 0.1, 2}});
  EXPECT_NEAR(atmosphere.over(Band(0.69, 0.68), 0).direct_w_m2,
              atmosphere.over(Band({{0.35, 1}, {1.03, 1}}), 0).direct_w_m2, 1e-9);
  EXPECT_THROW(atmosphere.over(Band(0.69, 0.6801), 0), ImpossibleRequest);
}

std::string refusal_of(const std::string& text) {
  TemporaryFolder folder;
  const std::string path = folder.path() + "/table.csv";
  std::ofstream(path) << text;
  try {
    Atmosphere::read(path);
  } catch (const DataError& e) {
    EXPECT_NE(std::string(e.what()).find("table.csv"), std::string::npos);
    return e.what();
  }
  return "";
}

TEST(Atmosphere, FilesAreReadAndRefusedByLine) {
  const std::string header =
      "# made up\nwavelength_um,transmittance,e_sun_w_m2_um,l_ind_w_m2_sr_um,l_sc_w_m2_sr_um,l_th_w_m2_sr_um\n";
  TemporaryFolder folder;
  std::ofstream(folder.path() + "/good.csv") << header << "0.4,0.5,1700,1,2,0\r\n\n# more\n0.5,0.6,1900.5,1e-1,2,0\n";
  const Atmosphere good = Atmosphere::read(folder.path() + "/good.csv");
  ASSERT_EQ(good.rows().size(), 2U);
  EXPECT_EQ(good.rows()[1].irradiance_w_m2_um, 1900.5);
  EXPECT_EQ(good.rows()[1].indirect_w_m2_sr_um, 0.1);
  EXPECT_THROW(Atmosphere::read(folder.path() + "/none.csv"), DataError);
  EXPECT_NE(refusal_of("").find("two rows"), std::string::npos);
  EXPECT_NE(refusal_of("wavelength,tau\n").find("line 1"), std::string::npos);
  EXPECT_NE(refusal_of(header + "0.4,0.5,1700,1,2\n").find("line 3"), std::string::npos);
  EXPECT_NE(refusal_of(header + "0.4,0.5,1700,1,2,0,9\n").find("line 3"), std::string::npos);
  EXPECT_NE(refusal_of(header + "0.4,0.5,1700,x,2,0\n").find("line 3"), std::string::npos);
  EXPECT_NE(refusal_of(header + "0.4,1.5,1700,1,2,0\n").find("transmittance"), std::string::npos);
  EXPECT_NE(refusal_of(header + "0.4,nan,1700,1,2,0\n").find("line 3"), std::string::npos);
  EXPECT_NE(refusal_of(header + "0.4,0.5,1700,1,2,0\n0.4,0.5,1700,1,2,0\n").find("must rise"), std::string::npos);
}

}  // namespace
}  // namespace selenograph::engine
