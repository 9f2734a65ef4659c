// Exposure and quantisation by hand.
#include "engine/sensor/sensor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace selenograph::engine {
namespace {

using Image = std::vector<std::uint16_t>;

TEST(Sensor, GivenExposure) {
  Image image;
  EXPECT_EQ(expose({8, 10.0}, {0.F, 2.F, 5.F, 10.F, 11.F, 1e30F}, image), 10);
  EXPECT_EQ(image, (Image{0, 51, 128, 255, 255, 255}));  // 127.5 rounds to even
  EXPECT_EQ(expose({16, 10.0}, {0.F, 2.F, 10.F, 20.F}, image), 10);
  EXPECT_EQ(image, (Image{0, 13107, 65535, 65535}));
}

TEST(Sensor, AutomaticExposureFillsTheRange) {
  Image image;
  EXPECT_EQ(expose({8, {}}, {0.F, 0.5F, 4.F}, image), 4);
  EXPECT_EQ(image, (Image{0, 32, 255}));
}

// The brightest thousandth of the lit pixels is clipped, wherever they lie.
TEST(Sensor, TheAutomaticScaleLeavesOutTheBrightestThousandth) {
  std::mt19937 random(3);
  for (const std::size_t lit : {1U, 999U, 1000U, 30000U, 123457U, 300000U})
    for (const bool together : {false, true}) {
      std::vector<float> radiance(300000, 0.F);
      for (std::size_t i = 0; i < lit; ++i) radiance[i] = std::exp(std::normal_distribution<float>()(random));
      std::vector<float> sorted(radiance.begin(), radiance.begin() + static_cast<std::ptrdiff_t>(lit));
      std::sort(sorted.begin(), sorted.end());
      radiance.back() = lit < radiance.size() ? std::numeric_limits<float>::quiet_NaN() : radiance.back();
      if (!together) std::shuffle(radiance.begin(), radiance.end(), random);
      EXPECT_EQ(almost_brightest(radiance), static_cast<double>(sorted[lit - 1 - lit / 1000])) << lit;
    }
  EXPECT_EQ(almost_brightest(std::vector<float>{}), 0);
  EXPECT_EQ(almost_brightest(std::vector<float>(1000, std::numeric_limits<float>::quiet_NaN())), 0);
}

TEST(Sensor, DarkStaysDark) {
  Image image{7};
  EXPECT_EQ(expose({8, {}}, {0.F, 0.F, 0.F}, image), 0);
  EXPECT_EQ(image, (Image{0, 0, 0}));
  EXPECT_EQ(expose({16, 5.0}, {0.F}, image), 5);
  EXPECT_EQ(image, (Image{0}));
  EXPECT_EQ(expose({8, {}}, {}, image), 0);
  EXPECT_TRUE(image.empty());
}

TEST(Sensor, TheBrightestPixelIsTheFirstOfEquals) {
  std::vector<float> radiance(300000, 1.F);  // several tasks
  EXPECT_EQ(brightest_pixel(radiance), 0U);
  for (const std::size_t at : {299999U, 131073U, 131072U, 131071U, 17U, 0U}) {  // each before all those above
    radiance[at] = 2;
    EXPECT_EQ(brightest_pixel(radiance), at);
  }
  radiance[222222] = 3;
  EXPECT_EQ(brightest_pixel(radiance), 222222U);
  EXPECT_EQ(brightest_pixel(std::vector<float>{-2.F, -1.F, -3.F}), 1U);
}

TEST(Sensor, ManyPixelsAreExposedAsFew) {
  std::vector<float> radiance(300000);
  for (std::size_t i = 0; i < radiance.size(); ++i) radiance[i] = static_cast<float>(i % 4001) * 0.0025F;
  Image image;
  EXPECT_EQ(expose({16, 8.0}, radiance, image), 8);
  for (std::size_t i = 0; i < radiance.size(); ++i) {
    const double dn = std::nearbyint(static_cast<double>(radiance[i]) * (65535 / 8.0));
    ASSERT_EQ(image[i], std::min(dn, 65535.0)) << i;
  }
  const auto above = std::ranges::count_if(radiance, [](float value) { return value > 8; });
  EXPECT_EQ(share_above(radiance, 8), static_cast<double>(above) / 300000);
}

TEST(Sensor, OnlyRadianceAboveZeroIsLight) {
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(any_lit(std::vector<float>{}));
  EXPECT_FALSE(any_lit(std::vector<float>{0.F, -1.F, kNone}));
  EXPECT_TRUE(any_lit(std::vector<float>{kNone, 0.F, 1e-30F}));
}

TEST(Sensor, MonotoneAndNeverOffByMoreThanHalfAStep) {
  std::vector<float> radiance;
  for (int i = 0; i <= 5000; ++i) radiance.push_back(static_cast<float>(i) * 0.01F);
  for (const int bits : {8, 16}) {
    Image image;
    const double top = bits == 8 ? 255 : 65535;
    const double full = expose({bits, {}}, radiance, image);
    for (std::size_t i = 0; i < radiance.size(); ++i) {
      ASSERT_NEAR(image[i], std::min(static_cast<double>(radiance[i]) / full, 1.0) * top, 0.5 + 1e-9);
      if (i > 0) {
        ASSERT_GE(image[i], image[i - 1]);
      }
    }
  }
}

// The optics darken the brightest radiance, which is in a corner, below that of the middle.
TEST(Sensor, TheBrightestSignalIsThatOfTheImage) {
  FrameRequest request;
  request.camera.width = request.camera.height = 64;
  request.camera.fx = request.camera.fy = 40, request.camera.cx = request.camera.cy = 31.5;
  request.band = Band(0.65, 0.1);
  SensorModel model;
  model.optics.f_number = 4, model.optics.vignetting.model = Vignetting::Model::cos4;
  model.detector.pixel_pitch_um = 5, model.detector.integration_time_s = 0.01, model.detector.bit_depth = 16;
  model.detector.photon_noise = false;
  request.sensor = model;
  Sensor sensor(request);
  std::vector<float> radiance(64 * 64, 1.F);
  radiance[0] = 1.2F;
  Image image;
  sensor.image(request.camera, {}, radiance, image);
  const int brightest_dn = *std::max_element(image.begin(), image.end());
  EXPECT_GT(brightest_dn, 1000);
  EXPECT_GT(brightest_dn, 3 * image[0]);
  EXPECT_NEAR(sensor.brightest_signal_e(), brightest_dn, 0.5);
}

}  // namespace
}  // namespace selenograph::engine
