// MERTIS: values by hand, and what must hold whatever was assumed.
#include "engine/sensor/spectrometer.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <numbers>

#include "engine/radiometry/spectrum.h"

namespace selenograph::engine {
namespace {

TEST(Spectrometer, ByHand) {
  const auto channels = look_at_blackbody({}, 400);
  ASSERT_EQ(channels.size(), 80U);
  EXPECT_DOUBLE_EQ(channels[0].width_um, 0.0875);
  EXPECT_NEAR(channels[0].center_um, 7.04375, 1e-12);
  EXPECT_NEAR(channels[79].center_um, 13.95625, 1e-12);
  // Channel 34 at 10.01875 um: 2 h c^2 / lambda^5 / (exp(c2 / lambda T) - 1) = 33.246 W m-2 sr-1 um-1;
  // Phi = pi / 4 (35e-6)^2 / 4 0.3 33.246 0.0875.
  const SpectrometerChannel& c = channels[34];
  const double radiance = 1.191042972397e8 / std::pow(10.01875, 5) / std::expm1(14387.768775 / (10.01875 * 400));
  EXPECT_NEAR(c.radiance_w_m2_sr_um, radiance, 1e-8 * radiance);
  EXPECT_NEAR(c.flux_w, std::numbers::pi / 4 * 1225e-12 / 4 * 0.3 * radiance * 0.0875, 1e-16);
  EXPECT_NEAR(c.signal_to_noise, c.flux_w / 1e-12, 1e-9);
  EXPECT_LT(std::abs(c.width_error), 1e-4);  // Delta lambda << lambda
}

TEST(Spectrometer, FluxIsLinearInTheWidth) {
  Spectrometer wide, narrow;
  wide.first_um = 9.9, wide.last_um = 10.1, wide.channels = 1;
  narrow.first_um = 9.99, narrow.last_um = 10.01, narrow.channels = 1;
  EXPECT_NEAR(look_at_blackbody(wide, 350)[0].flux_w / look_at_blackbody(narrow, 350)[0].flux_w, 10, 1e-9);
}

TEST(Spectrometer, SignalsToNoiseAreAsPlanckSays) {
  Spectrometer s;
  s.efficiency = {{7, 0.1}, {9, 0.5}, {14, 0.2}}, s.noise_equivalent_power_w = 3e-12, s.f_number = 1.7;
  const auto cold = look_at_blackbody(s, 350), hot = look_at_blackbody(s, 500);
  for (std::size_t i = 0; i < cold.size(); ++i)
    EXPECT_NEAR(hot[i].signal_to_noise / cold[i].signal_to_noise,
                planck_w_m2_sr_um(cold[i].center_um, 500) / planck_w_m2_sr_um(cold[i].center_um, 350), 1e-10);
  EXPECT_NEAR(cold[0].efficiency, 0.1 + 0.4 * 0.04375 / 2, 1e-12);
}

TEST(Spectrometer, StopsAtTheDeadline) {
  EXPECT_THROW(look_at_blackbody({}, 300, StopToken(std::chrono::steady_clock::now())), Cancelled);
}

}  // namespace
}  // namespace selenograph::engine
