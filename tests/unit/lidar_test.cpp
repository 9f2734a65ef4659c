// Lidars in closed form: widths of echoes, the lidar equation, Poisson statistics, Doppler.
#include "engine/lidar/lidar.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "dem/base/error.h"
#include "engine/camera/pose_track.h"
#include "engine/lidar/beam.h"
#include "engine/lidar/detection.h"
#include "engine/lidar/echo.h"
#include "engine/lidar/pattern.h"
#include "tests/support/moon_without_relief.h"
#include "tests/support/queries.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

using test::kDegree;

constexpr int kNumbers[] = {1, 7, 19, 37, 61};

TEST(LidarBeam, PartsHaveTheMomentsOfTheBeam) {
  for (const int number : kNumbers) {
    const SubRays beam(number);
    ASSERT_EQ(beam.rays.size(), static_cast<std::size_t>(number));
    EXPECT_EQ(std::hypot(beam.rays[0].x, beam.rays[0].y), 0) << "the axis is the first";
    double sum = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
    for (const SubRay& ray : beam.rays) {
      sum += ray.weight, x += ray.weight * ray.x, y += ray.weight * ray.y;
      xx += ray.weight * ray.x * ray.x, xy += ray.weight * ray.x * ray.y, yy += ray.weight * ray.y * ray.y;
      EXPECT_GT(ray.weight, 0);
    }
    EXPECT_NEAR(sum, 1, 1e-12);
    EXPECT_NEAR(std::abs(x) + std::abs(y) + std::abs(xy), 0, 1e-12);
    EXPECT_NEAR(xx + beam.deviation * beam.deviation, 1, 1e-9) << number;
    EXPECT_NEAR(yy + beam.deviation * beam.deviation, 1, 1e-9) << number;
  }
  // Of seven the fourth moments, too: 3 along a direction, of points and their parts.
  const SubRays seven(7);
  double fourth = 0;
  for (const SubRay& ray : seven.rays)
    fourth +=
        ray.weight * (std::pow(ray.x, 4) + 6 * std::pow(ray.x * seven.deviation, 2) + 3 * std::pow(seven.deviation, 4));
  EXPECT_NEAR(fourth, 3, 1e-12);
}

// The light on one side of an edge, in all directions and just before and behind each sub-ray, against the Gaussian's.
TEST(LidarBeam, AnEdgeDividesItWithinTheDocumentedShare) {
  for (const auto& [number, stated] : {std::pair{1, 0.5}, {7, 0.34}, {19, 0.23}, {37, 0.17}, {61, 0.13}}) {
    const SubRays beam(number);
    double worst = 0;
    for (int step = 0; step <= 60; ++step) {
      const double angle = std::numbers::pi / 3 * step / 60;
      const auto place = [&](const SubRay& ray) { return ray.x * std::cos(angle) + ray.y * std::sin(angle); };
      for (const SubRay& at : beam.rays)
        for (const double edge : {place(at) - 1e-6, place(at) + 1e-6}) {
          double share = 0;
          for (const SubRay& ray : beam.rays) share += place(ray) < edge ? ray.weight : 0;
          worst = std::max(worst, std::abs(share - std::erfc(-edge / std::numbers::sqrt2) / 2));
        }
    }
    EXPECT_NEAR(worst, stated, 0.01) << number;
  }
}

// The echo of a plane that is tilted against the beam, by its sub-rays.
std::vector<EchoPart> echo_of_plane(int sub_rays, double range_m, double theta, double tilt_deg, double pulse_m) {
  const SubRays beam(sub_rays);
  const Vec3 normal(std::sin(tilt_deg * kDegree), 0, -std::cos(tilt_deg * kDegree));
  std::vector<EchoPart> parts;
  for (const SubRay& ray : beam.rays) {
    const Vec3 direction = Vec3(theta * ray.x, theta * ray.y, 1).normalized();
    const double toward = -normal.dot(direction), distance = range_m * std::cos(tilt_deg * kDegree) / toward;
    parts.push_back({distance, part_deviation_m(pulse_m, distance, theta * beam.deviation, toward), ray.weight, 0});
  }
  return parts;
}

// Gardner 1992: pulse, wavefront, slope.
TEST(LidarEcho, OfATiltedPlaneIsAsWideAsTheClosedForm) {
  for (const int number : kNumbers)
    for (const double tilt_deg : {0.0, 10.0, 30.0, 60.0}) {
      const double range_m = 1000, theta = 2e-4, pulse_m = pulse_deviation_m(2), slope = std::tan(tilt_deg * kDegree);
      std::vector<EchoPart> parts = echo_of_plane(number, range_m, theta, tilt_deg, pulse_m);
      Echo echo;
      const auto returns = echo.resolve_returns(parts);
      ASSERT_EQ(returns.size(), 1U) << number << " sub-rays, tilt " << tilt_deg << ": a plane has one return";
      const double width_m =
          std::sqrt(pulse_m * pulse_m + range_m * range_m * theta * theta * (theta * theta + slope * slope));
      EXPECT_NEAR(returns[0].width_m, width_m, 2e-3 * width_m) << number << " sub-rays, tilt " << tilt_deg;
      // The curved wavefront and the perspective across the beam.
      EXPECT_NEAR(returns[0].range_m, range_m * (1 + theta * theta * (1 + slope * slope)), 1e-5 * range_m);
      EXPECT_NEAR(returns[0].signal, 1, 1e-12);
    }
}

TEST(LidarEcho, OfAStepHasTwoReturns) {
  const double pulse_m = pulse_deviation_m(1);
  Echo echo;
  std::vector<EchoPart> parts{{102, pulse_m, 1, 7}, {100, pulse_m, 2, 5}, {100.01, pulse_m, 1, 5}};
  const auto two = echo.resolve_returns(parts);
  ASSERT_EQ(two.size(), 2U);
  EXPECT_NEAR(two[0].range_m, 100 + 0.01 / 3, 1e-9);
  EXPECT_NEAR(two[0].signal, 3, 1e-12);
  EXPECT_EQ(two[0].source, 5U);
  EXPECT_NEAR(two[1].range_m, 102, 1e-9);
  EXPECT_NEAR(two[1].width_m, pulse_m, 1e-9);
  EXPECT_EQ(two[1].source, 7U);
  // Two equal pulses have a dip where they are more than two deviations apart: at 3.2 it is 56 % deep, at 2.2 nearly
  // none.
  const auto number = [&](double apart) {
    std::vector<EchoPart> pair{{100, pulse_m, 1}, {100 + apart * pulse_m, pulse_m, 1}};
    return echo.resolve_returns(pair).size();
  };
  EXPECT_EQ(number(0.5), 1U);
  EXPECT_EQ(number(2.2), 1U);
  EXPECT_EQ(number(3.2), 2U);
  EXPECT_EQ(number(7.5), 2U);
  EXPECT_EQ(number(20), 2U);
}

LidarInstrument counting() {
  LidarInstrument lidar;
  lidar.receiver = {LidarSignal::photon_counting, 1e-5, 0.05, 0.2, 0, 0, 0.12};
  lidar.gate = {50, 5000}, lidar.threshold = 4, lidar.dark_count_hz = 3e7, lidar.pulse_length_ns = 4;
  return lidar;
}

TEST(LidarDetection, RatesAreThoseOfPoissonStatistics) {
  const LidarReceiverModel receiver(counting());
  constexpr int kBeams = 40000;
  constexpr double kDark = 3e7 * 4e-9;  // within the pulse
  for (const double signal : {1.0, 3.0, 6.0, 25.0}) {
    const std::vector<EchoReturn> returns{{1000, pulse_deviation_m(4), signal, 0}};
    int detected = 0;
    double sum = 0, square = 0;
    for (std::uint32_t beam = 0; beam < kBeams; ++beam) {
      const LidarDetection found = receiver.detect(returns, 11, 3, beam);
      // A false alarm may be the stronger one: it is somewhere else, but for a few.
      for (const double range_m : {found.strongest_m, found.first_m, found.last_m}) {
        if (!(std::abs(range_m - 1000) < 5)) continue;
        ++detected, sum += range_m - 1000, square += (range_m - 1000) * (range_m - 1000);
        break;
      }
    }
    const double chance = poisson_tail(signal + kDark, 4), deviation = std::sqrt(chance * (1 - chance) / kBeams);
    EXPECT_NEAR(static_cast<double>(detected) / kBeams, chance, 4.5 * deviation + 2e-4) << signal;
    if (signal < 20) continue;
    EXPECT_NEAR(sum / detected, 0, 0.01);
    EXPECT_NEAR(std::sqrt(square / detected), pulse_deviation_m(4) / std::sqrt(signal), 0.03 * pulse_deviation_m(4));
  }
}

TEST(LidarDetection, FalseAlarmsHaveTheirClosedForm) {
  LidarInstrument lidar = counting();
  const LidarReceiverModel receiver(lidar);
  // 4950 m are 8256 cells of 0.6 m, each with a mean of 0.12.
  const double mean = 3e7 * 4e-9, p = 1 - std::exp(-mean) * (1 + mean + mean * mean / 2 + mean * mean * mean / 6);
  EXPECT_NEAR(receiver.expected_false_alarms(), p * 4950 / (0.299792458 / 2 * 4), 1e-6);
  constexpr int kBeams = 100000;
  int any = 0;
  double sum = 0;
  for (std::uint32_t beam = 0; beam < kBeams; ++beam) {
    const LidarDetection found = receiver.detect({}, 5, 0, beam);
    if (found.count == 0) continue;
    ++any, sum += found.first_m;
    EXPECT_TRUE(found.false_alarm);
    EXPECT_TRUE(found.first_m >= 50 && found.last_m <= 5000 && found.first_m <= found.last_m);
  }
  const double chance = 1 - std::exp(-receiver.expected_false_alarms());
  EXPECT_NEAR(static_cast<double>(any) / kBeams, chance, 4.5 * std::sqrt(chance / kBeams));
  EXPECT_NEAR(sum / any, 2525, 4.5 * 4950 / std::sqrt(12.0 * any) + 4950 * receiver.expected_false_alarms() / 6);
  // By the normal distribution where the noise is the receiver's.
  EXPECT_NEAR(normal_tail(0), 0.5, 1e-12);
  EXPECT_NEAR(normal_tail(-1), 0.8413447461, 1e-9);
  EXPECT_NEAR(poisson_tail(10, 11), 0.41696, 1e-5);
  EXPECT_NEAR(poisson_tail(1e-3, 3), 1.6654e-10, 1e-13);
}

// Ten cells of the gate, most of which have an alarm: their number is binomial, and never larger than ten.
TEST(LidarDetection, EachCellHasAtMostOneFalseAlarm) {
  LidarInstrument lidar = counting();
  const double cell_m = 0.299792458 / 2 * 4;
  lidar.threshold = 1, lidar.dark_count_hz = 3e8, lidar.gate = {100, 100 + 10 * cell_m};
  const LidarReceiverModel receiver(lidar);
  const double chance = 1 - std::exp(-3e8 * 4e-9);
  EXPECT_NEAR(receiver.expected_false_alarms(), 10 * chance, 1e-9);
  constexpr int kBeams = 40000;
  double sum = 0, square = 0, first = 0;
  for (std::uint32_t beam = 0; beam < kBeams; ++beam) {
    const LidarDetection found = receiver.detect({}, 5, 0, beam);
    ASSERT_LE(found.count, 10);
    sum += found.count, square += found.count * found.count;
    if (found.count > 0) first += (found.first_m - 100) / cell_m < 1;
  }
  const double mean = sum / kBeams, variance = 10 * chance * (1 - chance);
  EXPECT_NEAR(mean, 10 * chance, 4.5 * std::sqrt(variance / kBeams));
  EXPECT_NEAR(square / kBeams - mean * mean, variance, 0.05 * variance) << "of Poisson statistics: " << 10 * chance;
  EXPECT_NEAR(first / kBeams, chance, 4.5 * std::sqrt(chance * (1 - chance) / kBeams)) << "in the first cell";
}

// More alarms than are drawn one by one: nearest and farthest are still within a few cells of the gate's ends.
TEST(LidarDetection, ManyFalseAlarmsFillTheGate) {
  LidarInstrument lidar = counting();
  lidar.threshold = 1, lidar.dark_count_hz = 3e8;
  const LidarReceiverModel receiver(lidar);
  double strongest_m = 0;
  constexpr int kBeams = 2000;
  for (std::uint32_t beam = 0; beam < kBeams; ++beam) {
    const LidarDetection found = receiver.detect({}, 5, 0, beam);
    EXPECT_EQ(found.count, 255);
    EXPECT_LT(found.first_m, 60);
    EXPECT_GT(found.last_m, 4990);
    EXPECT_LE(found.last_m, 5000);
    strongest_m += found.strongest_m / kBeams;
  }
  EXPECT_NEAR(strongest_m, 2525, 4.5 * 4950 / std::sqrt(12.0 * kBeams));
}

// The mean dark counts are subtracted from every count, also from one that is smaller.
TEST(LidarDetection, IntensityIsUnbiased) {
  LidarInstrument lidar = counting();
  lidar.threshold = 1, lidar.dark_count_hz = 1e10, lidar.gate = {999, 999.01};
  const LidarReceiverModel receiver(lidar);
  const std::vector<EchoReturn> returns{{999.005, pulse_deviation_m(4), 1, 0}};
  constexpr int kBeams = 40000;
  double sum = 0;
  int negative = 0;
  for (std::uint32_t beam = 0; beam < kBeams; ++beam) {
    const LidarDetection found = receiver.detect(returns, 9, 0, beam);
    if (found.count == 0 || found.false_alarm) continue;
    const auto intensity = static_cast<double>(found.strongest);
    sum += intensity, negative += intensity < 0;
  }
  EXPECT_NEAR(sum / kBeams, 1, 4.5 * std::sqrt(41.0 / kBeams));
  EXPECT_GT(negative, kBeams / 4);
}

TEST(LidarDetection, NoRangeIsNegative) {
  LidarInstrument lidar = counting();
  lidar.timing_noise_ns = 100, lidar.gate = {0, 1000};
  const LidarReceiverModel receiver(lidar);
  const std::vector<EchoReturn> returns{{0.5, pulse_deviation_m(4), 100, 0}};
  int at_aperture = 0;
  for (std::uint32_t beam = 0; beam < 1000; ++beam) {
    const LidarDetection found = receiver.detect(returns, 9, 0, beam);
    ASSERT_GE(found.first_m, 0);
    at_aperture += found.first_m == 0;
  }
  EXPECT_GT(at_aperture, 300);
}

// One photon is all that the threshold asks for: a return of one and each of some five alarms are equally strong.
TEST(LidarDetection, EquallyStrongDetectionsAreEquallyLikelyTheStrongest) {
  LidarInstrument lidar = counting();
  lidar.threshold = 1, lidar.dark_count_hz = 1e5, lidar.gate = {1000, 9000};
  const LidarReceiverModel receiver(lidar);
  const std::vector<EchoReturn> returns{{4000, pulse_deviation_m(4), 0.2, 0}};
  constexpr int kBeams = 40000;
  int real = 0, alarms = 0;
  double sum = 0, square = 0;
  for (std::uint32_t beam = 0; beam < kBeams; ++beam) {
    const LidarDetection found = receiver.detect(returns, 3, 0, beam);
    if (found.count > 0 && !found.false_alarm) ++real;
    if (!found.false_alarm) continue;
    ++alarms, sum += found.strongest_m, square += found.strongest_m * found.strongest_m;
    EXPECT_TRUE(found.first_m <= found.strongest_m && found.strongest_m <= found.last_m);
    EXPECT_EQ(found.strongest, found.first) << "alarms are alike";
  }
  const double mean = 0.2 + 1e5 * 4e-9, one = mean * std::exp(-mean), more = 1 - std::exp(-mean) - one,
               false_alarms = receiver.expected_false_alarms();
  ASSERT_GT(false_alarms, 5);
  // The mean of 1 / (1 + n) over n of Poisson statistics.
  const double chance = more + one * (1 - std::exp(-false_alarms)) / false_alarms;
  EXPECT_NEAR(static_cast<double>(real) / kBeams, chance, 4.5 * std::sqrt(chance / kBeams));
  const double at = sum / alarms, deviation = std::sqrt(square / alarms - at * at);
  EXPECT_NEAR(at, 5000, 4.5 * 8000 / std::sqrt(12.0 * alarms)) << "uniform over the gate";
  EXPECT_NEAR(deviation, 8000 / std::sqrt(12.0), 40);
}

TEST(LidarDetection, SameSeedSameNumbersAnotherSeedOthers) {
  const LidarReceiverModel receiver(counting());
  const std::vector<EchoReturn> returns{{1000, 0.3, 50, 0}};
  const auto range_m = [&](std::uint64_t seed, std::uint64_t scan, std::uint32_t beam) {
    return receiver.detect(returns, seed, scan, beam).strongest_m;
  };
  EXPECT_EQ(range_m(1, 2, 3), range_m(1, 2, 3));
  EXPECT_NE(range_m(1, 2, 3), range_m(2, 2, 3));
  EXPECT_NE(range_m(1, 2, 3), range_m(1, 3, 3));
  EXPECT_NE(range_m(1, 2, 3), range_m(1, 2, 4));
}

TEST(LidarPattern, CellsOfARasterAndAFlash) {
  LidarPattern raster{.scan = LidarScan::raster,
                      .columns = 4,
                      .rows = 2,
                      .fov_x_deg = 8,
                      .fov_y_deg = 4,
                      .serpentine = true,
                      .rate_hz = 100};
  const std::vector<LidarPulse> none;
  const LidarBeams beams(none, raster);
  ASSERT_EQ(beams.size(), 8U);
  const LidarPulse first = beams.at(0), fifth = beams.at(4);
  EXPECT_NEAR(std::asin(first.direction.x()) / kDegree, -3, 1e-9);
  EXPECT_NEAR(std::asin(fifth.direction.x()) / kDegree, 3, 1e-9) << "backwards";
  EXPECT_NEAR(std::atan2(fifth.direction.y(), fifth.direction.z()) / kDegree, 1, 1e-9);
  EXPECT_NEAR(fifth.time_s, 0.04, 1e-12);
  EXPECT_NEAR(last_time_s(raster), 0.07, 1e-12);
  LidarPattern flash{.scan = LidarScan::flash, .columns = 4, .rows = 2, .fov_x_deg = 90, .rate_hz = 10, .repeats = 3};
  const LidarBeams shots(none, flash);
  ASSERT_EQ(shots.size(), 24U);
  const LidarPulse last = shots.at(23);
  EXPECT_NEAR(last.time_s, 0.2, 1e-12);
  EXPECT_NEAR(last.direction.x() / last.direction.z(), 0.75, 1e-12);
  EXPECT_NEAR(last.direction.y() / last.direction.z(), 0.25, 1e-12);
}

TEST(LidarMotion, RatesOfATrackAreTheDerivativesOfItsPoses) {
  const Pose start{Vec3(1740e3, 0, 0), Quat(0.5, 0.5, -0.5, 0.5)};
  std::vector<PoseAtTime> poses;
  for (const double t : {0.0, 1.0, 2.5, 4.0})
    poses.push_back({t, moved({start.position_m + Vec3(3 * t * t, 100 * t, 0), start.camera_from_moon},
                              {{1, 2, 3}, Vec3::zero()}, t)});
  const PoseTrack track(start, Rates{}, poses);
  for (const double t : {-1.0, 0.5, 1.7, 3.9, 5.0}) {
    const double h = 1e-3;
    const Vec3 velocity = (track.at(t + h).position_m - track.at(t - h).position_m) / (2 * h);
    EXPECT_LT((track.rates_at(t).velocity_m_s - velocity).norm(), 1e-4) << t;
    EXPECT_LT((track.rates_at(t).angular_rate_deg_s - Vec3(1, 2, 3)).norm(), 1e-9) << t;
  }
}

using SmoothMoonLidar = test::MoonWithoutRelief;

LidarRequest looking_down(double height_m, double off_nadir_deg) {
  LidarRequest request;
  request.instrument = counting();
  request.instrument.divergence_mrad = 1, request.instrument.sub_rays = 37;
  request.instrument.gate = {10, 1e6};
  const Vec3 from = to_cartesian({20, 30, height_m});
  request.pose = test::looking(from, -from, local_axes(20, 30).north);
  request.pulses = {{0, Vec3(std::sin(off_nadir_deg * kDegree), 0, std::cos(off_nadir_deg * kDegree))}};
  request.scenery.reflectance.model = ReflectanceModel::lambert, request.scenery.reflectance.rho = 0.2;
  return request;
}

TEST_F(SmoothMoonLidar, SignalIsTheLidarEquation) {
  for (const double height_m : {1000.0, 2000.0, 4000.0}) {
    const LidarReturns r = test::scan_lidar(renderer(), looking_down(height_m, 0));
    ASSERT_EQ(r.size(), 1U);
    EXPECT_NEAR(r.axis_range_m[0], height_m, 0.01);
    const double photons = 1e-5 * 1.064e-6 / (6.62607015e-34 * 299792458),
                 expected = photons * 0.2 * std::numbers::pi / 4 * 0.05 * 0.05 * 0.2 / std::numbers::pi /
                            (height_m * height_m);
    EXPECT_NEAR(static_cast<double>(r.true_intensity[0]), expected, 1e-4 * expected) << height_m;
    EXPECT_EQ(r.true_count[0], 1);
    EXPECT_EQ(r.rock[0], 0U);
  }
}

TEST_F(SmoothMoonLidar, OppositionIsInTheSignal) {
  LidarRequest request = looking_down(1000, 0);
  request.scenery.reflectance.model = ReflectanceModel::hapke;
  const double with = static_cast<double>(test::scan_lidar(renderer(), request).true_intensity[0]);
  request.scenery.reflectance.hapke.b0 = 0;
  EXPECT_GT(with, 1.5 * static_cast<double>(test::scan_lidar(renderer(), request).true_intensity[0]));
}

TEST_F(SmoothMoonLidar, WidthAtASlantIsTheClosedForm) {
  for (const int sub_rays : {1, 7, 37}) {
    LidarRequest request = looking_down(2000, 40);
    request.instrument.sub_rays = sub_rays;
    const LidarReturns r = test::scan_lidar(renderer(), request);
    const double range_m = r.axis_range_m[0], theta = 1e-3 / 4, pulse_m = pulse_deviation_m(4);
    // Seen from a sphere's surface the beam is as much steeper as the vertical turns on the way.
    const double incidence = 40 * kDegree + std::asin(range_m * std::sin(40 * kDegree) / kMoonRadius_m),
                 slope = std::tan(incidence);
    const double width_m = std::hypot(pulse_m, range_m * theta * std::hypot(theta, slope));
    EXPECT_NEAR(static_cast<double>(r.true_width_m[0]), width_m, 0.01 * width_m) << sub_rays;
    EXPECT_EQ(r.true_count[0], 1);
  }
}

TEST_F(SmoothMoonLidar, DopplerOfVelocityAndRotation) {
  LidarRequest request = looking_down(2000, 30);
  request.rates.velocity_m_s = Vec3(3, -20, 7), request.rates.angular_rate_deg_s = Vec3(10, 20, 30);
  request.instrument.offset_m = Vec3(0.5, -1, 2);
  request.pulses.push_back({2.0, request.pulses[0].direction});
  const LidarReturns r = test::scan_lidar(renderer(), request);
  for (const std::size_t i : {0U, 1U}) {
    // The aperture's own way, by differences.
    const auto aperture = [&](double t) -> Vec3 {
      const Pose pose = moved(request.pose, request.rates, t);
      return pose.position_m + pose.camera_from_moon.conjugate() * request.instrument.offset_m;
    };
    const double t = request.pulses[i].time_s, h = 1e-3;
    const Vec3 velocity = (aperture(t + h) - aperture(t - h)) / (2 * h),
               direction(r.direction[3 * i], r.direction[3 * i + 1], r.direction[3 * i + 2]);
    EXPECT_NEAR(static_cast<double>(r.true_velocity_m_s[i]), velocity.dot(direction), 1e-5);
    EXPECT_LT((aperture(t) - Vec3(r.origin_m[3 * i], r.origin_m[3 * i + 1], r.origin_m[3 * i + 2])).norm(), 1e-6);
    EXPECT_EQ(r.velocity_m_s[i], r.true_velocity_m_s[i]);
    // It is how fast the range gets shorter, on ground that is level along the beam's turn: not here. But without the
    // turn:
  }
  request.rates.angular_rate_deg_s = Vec3::zero(), request.instrument.offset_m = Vec3::zero();
  request.pulses = {{0, Vec3::unit_z()}, {0.01, Vec3::unit_z()}};
  const LidarReturns down = test::scan_lidar(renderer(), request);
  EXPECT_NEAR(static_cast<double>(down.true_velocity_m_s[0]), (down.axis_range_m[0] - down.axis_range_m[1]) / 0.01,
              0.05);
}

TEST_F(SmoothMoonLidar, BeamsDontDependOnEachOther) {
  LidarRequest request = looking_down(150, 0);
  request.instrument.sub_rays = 7;
  request.pulses.clear();
  request.pattern = {.scan = LidarScan::flash, .columns = 20, .rows = 15, .fov_x_deg = 10};
  const LidarReturns all = test::scan_lidar(renderer(), request);
  ASSERT_EQ(all.size(), 300U);
  const std::vector<LidarPulse> none;
  for (const std::size_t i : {0U, 17U, 150U, 299U}) {
    LidarRequest one = request;
    one.pulses = {LidarBeams(none, request.pattern).at(i)};
    const LidarReturns alone = test::scan_lidar(renderer(), one);
    EXPECT_EQ(alone.true_range_m[0], all.true_range_m[i]) << i;
    EXPECT_EQ(alone.true_intensity[0], all.true_intensity[i]);
    EXPECT_EQ(alone.true_width_m[0], all.true_width_m[i]);
  }
}

TEST_F(SmoothMoonLidar, ATrackThatDipsBelowTheTerrainIsRefused) {
  LidarRequest request = looking_down(1500, 0);
  const auto at = [&](double time_s, double height_m) {
    return PoseAtTime{time_s, {to_cartesian({20, 30, height_m}), request.pose.camera_from_moon}};
  };
  request.pulses.clear();
  for (const int beams : {9, 20000}) {
    request.pattern = {.scan = LidarScan::cone, .beams = beams, .half_angle_deg = 2, .rate_hz = (beams - 1) / 2.0};
    for (const double lowest_m : {-5000.0, -2.0, 2.0}) {
      request.poses = {at(0, 1500), at(1, lowest_m), at(2, 1500)};
      if (lowest_m > 0) {
        EXPECT_NO_THROW(test::scan_lidar(renderer(), request)) << beams;
        continue;
      }
      try {
        test::scan_lidar(renderer(), request);
        FAIL() << beams << " beams, down to " << lowest_m << " m";
      } catch (const ImpossibleRequest& e) {
        EXPECT_NE(std::string(e.what()).find("below the terrain"), std::string::npos) << e.what();
      }
    }
  }
}

TEST_F(SmoothMoonLidar, AtTheMoonsCentreThereIsNoLidar) {
  LidarRequest request = looking_down(1500, 0);
  request.pose.position_m = Vec3::zero();
  EXPECT_THROW(test::scan_lidar(renderer(), request), ImpossibleRequest);
}

TEST_F(SmoothMoonLidar, NothingComesBackFromTheSky) {
  LidarRequest request = looking_down(1500, 120);
  request.instrument.dark_count_hz = 0;
  const LidarReturns r = test::scan_lidar(renderer(), request);
  EXPECT_TRUE(std::isnan(r.range_m[0]) && std::isnan(r.true_range_m[0]) && std::isnan(r.axis_range_m[0]));
  EXPECT_EQ(r.count[0], 0);
  EXPECT_TRUE(std::isnan(r.velocity_m_s[0]));
}

}  // namespace
}  // namespace selenograph::engine
