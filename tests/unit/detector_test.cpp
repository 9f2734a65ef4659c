// Equations (8), (9) and (12) by hand, and the statistics of a detector's images.
#include "engine/sensor/detector.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <vector>

namespace selenograph::engine {
namespace {

constexpr int kSide = 512;
constexpr std::size_t kPixels = std::size_t{kSide} * kSide;

// One electron per digital number, and as many electrons as radiance.
SensorModel plain() {
  SensorModel s;
  s.optics.f_number = 4;
  Detector& d = s.detector;
  d.pixel_pitch_um = 5.5, d.quantum_efficiency = 0.5, d.gain_e_dn = 1, d.bit_depth = 16, d.photon_noise = false;
  d.integration_time_s = 1;
  d.integration_time_s = 1 / electrons_per_radiance(s.optics, d, 0.65);
  return s;
}

std::vector<std::uint16_t> image_of(const SensorModel& sensor, float electrons, int side = kSide) {
  std::vector<std::uint16_t> image;
  const std::size_t pixels = static_cast<std::size_t>(side) * static_cast<std::size_t>(side);
  detect(sensor, 0.65, std::vector<float>(pixels, electrons), side, side, image);
  return image;
}

struct Moments {
  double mean, variance;
};
Moments moments(const std::vector<std::uint16_t>& image) {
  double sum = 0, squares = 0;
  for (const std::uint16_t dn : image) sum += dn;
  const double n = static_cast<double>(image.size()), mean = sum / n;
  for (const std::uint16_t dn : image) squares += (dn - mean) * (dn - mean);
  return {mean, squares / (n - 1)};
}

// 10 ms, 5.5 um, f/4, 40 %: 0.01 pi (5.5e-6)^2 / 64 0.4 0.65e-6 / (6.62607015e-34 299792458) = 19435.3...
TEST(Detector, Equation8ByHand) {
  Optics optics;
  optics.f_number = 4;
  Detector d;
  d.pixel_pitch_um = 5.5, d.quantum_efficiency = 0.4, d.integration_time_s = 0.01;
  const double photons = 0.65e-6 / (6.62607015e-34 * 299792458);
  EXPECT_NEAR(photons, 3.2721757689e18, 1e8);
  EXPECT_NEAR(electrons_per_radiance(optics, d, 0.65), 0.01 * std::numbers::pi * 30.25e-12 / 64 * 0.4 * photons, 1e-6);
  EXPECT_NEAR(electrons_per_radiance(optics, d, 0.65), 19435.3, 0.1);
}

TEST(Detector, Equations9And12ByHand) {
  // A 35 um bolometer behind f/2 with 50 %: pi / 4 1.225e-9 / 4 0.5 2 = 2.405e-10 W of 2 W m-2 sr-1.
  EXPECT_NEAR(radiant_flux_w(35, 2, 0.5, 2), 2.4053e-10, 1e-14);
  EXPECT_DOUBLE_EQ(radiant_flux_w(35, 2, 0.5, 4), 2 * radiant_flux_w(35, 2, 0.5, 2));
  EXPECT_DOUBLE_EQ(signal_to_noise(2.4e-10, 1.2e-12), 200);
}

// The rows of a line camera are one line of pixels: its pattern is the first row's, its noise is not.
TEST(Detector, ALinesPatternIsEachRows) {
  SensorModel s = plain();
  s.detector.prnu = 0.1, s.detector.dsnu_e = 20, s.detector.dead_fraction = 0.1;
  constexpr int kWidth = 90, kHeight = 7;  // rows begin within what is drawn at once
  const std::vector<float> radiance(kWidth * kHeight, 1000.F);
  std::vector<std::uint16_t> line, area;
  detect(s, 0.65, radiance, kWidth, kHeight, line, {}, true);
  detect(s, 0.65, radiance, kWidth, kHeight, area);
  for (int row = 0; row < kHeight; ++row)
    EXPECT_TRUE(std::equal(line.begin() + row * kWidth, line.begin() + (row + 1) * kWidth, area.begin())) << row;
  EXPECT_FALSE(std::equal(area.begin() + kWidth, area.begin() + 2 * kWidth, area.begin()));
  s.detector.read_noise_e = 10;
  detect(s, 0.65, radiance, kWidth, kHeight, line, {}, true);
  EXPECT_FALSE(std::equal(line.begin() + kWidth, line.begin() + 2 * kWidth, line.begin()));
}

TEST(Detector, CountsRoundsAndClips) {
  SensorModel s = plain();
  EXPECT_EQ(image_of(s, 1000.F, 8), std::vector<std::uint16_t>(64, 1000));
  s.detector.gain_e_dn = 3, s.detector.offset_dn = 10;
  EXPECT_EQ(image_of(s, 1000.F, 8), std::vector<std::uint16_t>(64, 343));  // 333.33 + 10
  s.detector.bit_depth = 8;
  EXPECT_EQ(image_of(s, 1000.F, 8), std::vector<std::uint16_t>(64, 255));
  s.detector.full_well_e = 300;
  EXPECT_EQ(image_of(s, 1000.F, 8), std::vector<std::uint16_t>(64, 110));
  EXPECT_EQ(image_of(s, 0.F, 8), std::vector<std::uint16_t>(64, 10));
  s.detector.dark_current_e_s = 60 / s.detector.integration_time_s;
  EXPECT_EQ(image_of(s, 0.F, 8), std::vector<std::uint16_t>(64, 30));
  s.detector.dead_fraction = 1;  // dark current and offset are left
  EXPECT_EQ(image_of(s, 1000.F, 8), std::vector<std::uint16_t>(64, 30));
}

// Means and variances within five standard errors: of a variance, variance sqrt(2 / n).
TEST(Detector, PhotonsArePoisson) {
  SensorModel s = plain();
  s.detector.photon_noise = true;
  for (const float electrons : {0.5F, 5.F, 50.F, 500.F, 20000.F}) {
    const Moments m = moments(image_of(s, electrons));
    const double mean = static_cast<double>(electrons), n = static_cast<double>(kPixels);
    EXPECT_NEAR(m.mean, mean, 5 * std::sqrt(mean / n)) << mean;
    EXPECT_NEAR(m.variance, mean, 5 * mean * std::sqrt((2 + 1 / mean) / n)) << mean;
  }
}

// The photon transfer curve: variance in DN^2 against mean in DN has slope 1 / gain, and reading noise at its foot.
TEST(Detector, PhotonTransferCurve) {
  SensorModel s = plain();
  s.detector.photon_noise = true, s.detector.read_noise_e = 30, s.detector.gain_e_dn = 4, s.detector.offset_dn = 100;
  double x = 0, y = 0, xx = 0, xy = 0;
  int n = 0;
  for (const float electrons : {200.F, 1000.F, 5000.F, 20000.F, 60000.F, 120000.F}) {
    const Moments m = moments(image_of(s, electrons));
    const double e = static_cast<double>(electrons);
    EXPECT_NEAR(m.mean, 100 + e / 4, 0.05 + 5 * std::sqrt(e / 16 / static_cast<double>(kPixels)));
    // Quantisation adds 1/12 DN^2.
    EXPECT_NEAR(m.variance, (e + 900) / 16 + 1.0 / 12,
                5 * (e + 900) / 16 * std::sqrt(2.0 / static_cast<double>(kPixels)));
    x += m.mean, y += m.variance, xx += m.mean * m.mean, xy += m.mean * m.variance, ++n;
  }
  EXPECT_NEAR((n * xy - x * y) / (n * xx - x * x), 0.25, 0.003);
}

TEST(Detector, FixedPatternIsTheDetectorsOwn) {
  SensorModel s = plain();
  s.detector.prnu = 0.02, s.detector.dsnu_e = 50, s.detector.offset_dn = 1000;
  const auto one = image_of(s, 20000.F);
  const Moments m = moments(one);
  EXPECT_NEAR(m.mean, 21000, 5);
  EXPECT_NEAR(m.variance, 400.0 * 400 + 50 * 50, 0.02 * 400 * 400);
  s.frame = 17;
  EXPECT_EQ(image_of(s, 20000.F), one);
  s.seed = 1;
  EXPECT_NE(image_of(s, 20000.F), one);
}

TEST(Detector, FramesAndPixelsAreIndependent) {
  SensorModel s = plain();
  s.detector.photon_noise = true, s.detector.read_noise_e = 20;
  s.frame = 1;
  const auto a = image_of(s, 4000.F), again = image_of(s, 4000.F);
  EXPECT_EQ(a, again);
  s.frame = 2;
  const auto b = image_of(s, 4000.F);
  double frames = 0, beside = 0, below = 0;
  for (std::size_t i = 0; i + kSide < kPixels; ++i) {
    const double x = a[i] - 4000.0;
    frames += x * (b[i] - 4000.0), beside += x * (a[i + 1] - 4000.0), below += x * (a[i + kSide] - 4000.0);
  }
  const double error = 5 * 4400 * std::sqrt(static_cast<double>(kPixels));  // of a sum of products, variance 4400 each
  EXPECT_NEAR(frames, 0, error);
  EXPECT_NEAR(beside, 0, error);
  EXPECT_NEAR(below, 0, error);
}

TEST(Detector, DefectsHaveTheirShare) {
  SensorModel s = plain();
  s.detector.dead_fraction = 0.01, s.detector.hot_fraction = 0.02;
  s.detector.hot_current_e_s = 7000 / s.detector.integration_time_s;
  int dead = 0, hot = 0;
  for (const std::uint16_t dn : image_of(s, 1000.F)) dead += dn == 0, hot += dn == 8000;
  const double n = static_cast<double>(kPixels);
  EXPECT_NEAR(dead, 0.01 * n, 5 * std::sqrt(0.01 * n));
  EXPECT_NEAR(hot, 0.02 * n, 5 * std::sqrt(0.02 * n));
}

// A bright spot leaves a stripe along its column: its light, times the time in each row over the exposure.
TEST(Detector, SmearIsTheColumnsLight) {
  SensorModel s = plain();
  s.detector.smear_time_s = s.detector.integration_time_s / 1000;
  std::vector<float> light(100 * 50, 0.F);
  for (int y = 10; y < 15; ++y) light[static_cast<std::size_t>(y * 50 + 7)] = 40000.F;
  std::vector<std::uint16_t> image;
  detect(s, 0.65, light, 50, 100, image);
  for (int y = 0; y < 100; ++y) {
    EXPECT_EQ(image[static_cast<std::size_t>(y * 50 + 7)], y >= 10 && y < 15 ? 40200 : 200);
    EXPECT_EQ(image[static_cast<std::size_t>(y * 50 + 8)], 0);
  }
}

// All but the brightest thousandth reach the target, smear and dark current included.
TEST(Detector, TimeToFillCountsDarkCurrentAndSmear) {
  constexpr int kWidth = 64, kHeight = 100;
  constexpr std::size_t kOver = kWidth * kHeight / 1000;
  std::vector<float> light(std::size_t{kWidth} * kHeight);
  for (std::size_t i = 0; i < light.size(); ++i) light[i] = static_cast<float>(100 + i * 7919 % 3001);
  for (const double smear_time_s : {0.0, 1e-4, 1e-3}) {
    SensorModel s = plain();
    const double unit_s = s.detector.integration_time_s;
    s.detector.dark_current_e_s = 300 / unit_s, s.detector.smear_time_s = smear_time_s * unit_s;
    for (const double target_e : {20000.0, 50000.0}) {
      s.detector.integration_time_s = time_to_fill_s(s, 0.65, target_e, light, kWidth, kHeight);
      std::vector<std::uint16_t> image;
      const ReadOut out = detect(s, 0.65, light, kWidth, kHeight, image);
      std::sort(image.begin(), image.end());
      EXPECT_NEAR(image[image.size() - 1 - kOver], target_e, 1) << smear_time_s;
      EXPECT_GE(image[image.size() - kOver], image[image.size() - 1 - kOver]);
      EXPECT_EQ(out.saturated_fraction, 0);
      EXPECT_NEAR(out.smear_e, smear_time_s * 1.7e5, smear_time_s * 0.3e5);
    }
  }
  SensorModel s = plain();
  s.detector.smear_time_s = s.detector.integration_time_s;
  EXPECT_LT(time_to_fill_s(s, 0.65, 50000, light, kWidth, kHeight), 0) << "smear alone is more";
  s = plain();
  EXPECT_GT(time_to_fill_s(s, 0.65, 50000, std::vector<float>(100, 0.F), 10, 10), 1e29) << "nothing fills it";
}

// The region alone counts, by a percentile or the mean.
TEST(Detector, MeteringIsOfItsRegion) {
  constexpr int kWidth = 64, kHeight = 48;
  constexpr ImageRegion kRegion{10, 20, 30, 20};
  std::vector<float> light(std::size_t{kWidth} * kHeight, 1e6F), inside;  // bright outside
  for (int y = kRegion.y; y < kRegion.y + kRegion.height; ++y)
    for (int x = kRegion.x; x < kRegion.x + kRegion.width; ++x) {
      inside.push_back(static_cast<float>(100 + (y * 977 + x * 7919) % 3001));
      light[static_cast<std::size_t>(y * kWidth + x)] = inside.back();
    }
  std::sort(inside.begin(), inside.end());
  SensorModel s = plain();
  const double unit_s = s.detector.integration_time_s;
  Metering& metering = s.exposure.metering;
  metering.region = kRegion;
  for (const double percentile : {100.0, 90.0, 50.0}) {
    metering.percentile = percentile;
    const auto brighter = static_cast<std::size_t>(std::lround(600 * (1 - percentile / 100)));
    EXPECT_NEAR(time_to_fill_s(s, 0.65, 5000, light, kWidth, kHeight) / unit_s,
                5000 / static_cast<double>(inside[599 - brighter]), 1e-5)
        << percentile;
  }
  metering.statistic = Metering::Statistic::mean;
  double sum = 0;
  for (const float value : inside) sum += static_cast<double>(value);
  EXPECT_NEAR(time_to_fill_s(s, 0.65, 5000, light, kWidth, kHeight) / unit_s, 5000 / (sum / 600), 1e-5);
}

// Charge is kept but for what leaves the image, no pixel holds more than the full well, and a lone blob's trail is
// symmetric.
TEST(Detector, BloomingKeepsTheCharge) {
  constexpr int kWidth = 3, kHeight = 101;
  constexpr double kFull_e = 1000;
  const auto sum_of = [](const std::vector<float>& e) {
    double sum = 0;
    for (const float value : e) sum += static_cast<double>(value);
    return sum;
  };
  std::vector<float> e(std::size_t{kWidth} * kHeight, 100.F);
  const auto at = [&](int x, int y) -> float& { return e[static_cast<std::size_t>(y * kWidth + x)]; };
  at(1, 49) = at(1, 50) = at(1, 51) = 5500;  // 13500 e- above: 7.5 pixels of 900 e- of room on either side
  at(2, 3) = 9000;                           // 8000 above: 2700 go up before the border, 1300 leave there
  const double before_e = sum_of(e), lost_e = bloom(kFull_e, kWidth, kHeight, e);
  EXPECT_NEAR(lost_e, 1300, 1e-3);
  EXPECT_NEAR(sum_of(e) + lost_e, before_e, 0.05);
  EXPECT_EQ(*std::max_element(e.begin(), e.end()), 1000);
  for (int d = 0; d <= 50; ++d) {
    EXPECT_EQ(at(0, 50 + d), 100);
    EXPECT_EQ(at(1, 50 + d), at(1, 50 - d)) << d;
    EXPECT_EQ(at(1, 50 + d), d <= 8 ? 1000 : d == 9 ? 550 : 100) << d;
  }
  SensorModel s = plain();
  s.detector.full_well_e = kFull_e, s.detector.photon_noise = true;
  std::vector<float> light(std::size_t{64} * 64, 100.F);
  light[std::size_t{32} * 64 + 20] = 20000;
  std::vector<std::uint16_t> with, without;
  detect(s, 0.65, light, 64, 64, without);
  s.detector.blooming = true;
  const ReadOut out = detect(s, 0.65, light, 64, 64, with);
  for (std::size_t i = 0; i < with.size(); ++i)
    if (i % 64 != 20) {
      ASSERT_EQ(with[i], without[i]) << i;  // other columns keep their noise
    }
  EXPECT_EQ(out.saturated_fraction, static_cast<double>(std::count(with.begin(), with.end(), 1000)) / 4096);
  EXPECT_NEAR(static_cast<double>(std::count(with.begin(), with.end(), 1000)), 1 + 19000.0 / 900, 2);
}

// What is at the top of the image, or held by a full pixel: with smear, noise and a fixed pattern.
TEST(Detector, SaturationIsCountedInTheImage) {
  std::vector<float> light(kPixels);
  for (std::size_t i = 0; i < kPixels; ++i) light[i] = static_cast<float>(i * 7919 % 80021);
  SensorModel s = plain();
  s.detector.smear_time_s = s.detector.integration_time_s / 5000;
  std::vector<std::uint16_t> image;
  const auto share_at = [&](int number) {
    return static_cast<double>(std::count(image.begin(), image.end(), number)) / static_cast<double>(kPixels);
  };
  for (const bool noise : {false, true}) {
    s.detector.photon_noise = noise, s.detector.read_noise_e = noise ? 20 : 0, s.detector.prnu = noise ? 0.02 : 0;
    const ReadOut out = detect(s, 0.65, light, kSide, kSide, image);
    EXPECT_EQ(out.saturated_fraction, share_at(65535)) << noise;
    EXPECT_GT(share_at(65535), 0.15);
  }
  s.detector.photon_noise = false, s.detector.read_noise_e = s.detector.prnu = 0, s.detector.full_well_e = 40000;
  const ReadOut out = detect(s, 0.65, light, kSide, kSide, image);
  EXPECT_NEAR(out.saturated_fraction, share_at(40000), 5e-5);
}

TEST(Detector, StopsAtTheDeadline) {
  std::vector<std::uint16_t> image;
  const StopToken now(std::chrono::steady_clock::now());
  EXPECT_THROW(detect(plain(), 0.65, std::vector<float>(kPixels, 1.F), kSide, kSide, image, now), Cancelled);
}

}  // namespace
}  // namespace selenograph::engine
