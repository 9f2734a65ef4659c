// Light that optics scatter: its energy by the law's own integral, its kernel by the law, glare by hand.
#include "engine/sensor/stray_light.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "engine/cache/render_cache.h"
#include "engine/camera/view.h"
#include "engine/radiometry/solar_spectrum.h"
#include "engine/radiometry/spectrum.h"
#include "tests/support/moon_without_relief.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

using std::numbers::pi;

StrayLight law(double b0_sr, double shoulder, double slope) { return {b0_sr, shoulder, slope, 0}; }
const StrayLight kLaws[] = {law(1, 0.01, -1.5), law(20, 0.002, -2), law(3000, 1e-4, -2.2), law(0.05, 1, -3)};

// The law's integral over a circle of direction cosines, in rings.
double in_rings(const StrayLight& s, double sine) {
  constexpr int kRings = 20000;
  double sum = 0;
  for (int i = 0; i < kRings; ++i) {
    // Closer in the middle.
    const double t = (i + 0.5) / kRings, d = sine * t * t * t, width = sine * 3 * t * t / kRings;
    sum += 2 * pi * d * width * s.b0_sr * std::pow(1 + d * d / (s.shoulder * s.shoulder), s.slope / 2);
  }
  return sum;
}

// The same over a square of pixels around the boresight: a circle's for each direction to the border.
double in_square(const StrayLight& s, double half, double focal_px) {
  constexpr int kDirections = 64;
  double sum = 0;
  for (int i = 0; i < kDirections; ++i)
    sum += in_rings(s, std::sin(std::atan(half / focal_px / std::cos(pi / 4 * (i + 0.5) / kDirections))));
  return sum / kDirections;
}

TEST(StrayLight, ScattersTheIntegralOfItsLaw) {
  for (const StrayLight& s : kLaws) {
    EXPECT_NEAR(ScatteredLight::share(s) / in_rings(s, 1), 1, 1e-6);
    EXPECT_LT(ScatteredLight::share(s), 0.5);
  }
}

double sum_of(const std::vector<float>& image) {
  double sum = 0;
  for (const float value : image) sum += static_cast<double>(value);
  return sum;
}

// All of a point's light but what leaves the image, to 1e-4 of it; and pixel by pixel what the law says.
TEST(StrayLight, KeepsAPointsEnergy) {
  const int side = 401, middle = 200;
  const Camera camera = test::square_camera(side, 12);
  for (const StrayLight& s : kLaws) {
    const ScatteredLight scattered(s, camera);
    std::vector<float> image(side * side, 0.F);
    image[middle * side + middle] = 1000;
    scattered.apply(image);
    const double kept = 1 - ScatteredLight::share(s) + in_square(s, side / 2.0, camera.fx);
    EXPECT_NEAR(sum_of(image) / 1000, kept, 1e-5) << s.b0_sr;
    // Energy in any smaller square, so that the kernel's middle is as good as its wings.
    for (const int half : {0, 1, 3, 12, 60}) {
      double within = 0;
      for (int y = -half; y <= half; ++y)
        for (int x = -half; x <= half; ++x) within += scattered.weight(x, y);
      EXPECT_NEAR(within / in_square(s, half + 0.5, camera.fx), 1, 1e-3) << s.b0_sr << " " << half;
    }
    for (const auto& [x, y] : {std::pair{150, 0}, {-40, 90}, {-200, -200}}) {
      const double tangent2 = (x * x + y * y) / (camera.fx * camera.fx), cos2 = 1 / (1 + tangent2);
      const double expected = s.b0_sr * std::pow(1 + tangent2 * cos2 / (s.shoulder * s.shoulder), s.slope / 2) * cos2 *
                              cos2 / (camera.fx * camera.fx);
      const auto at = static_cast<std::size_t>((middle + y) * side + middle + x);
      EXPECT_NEAR(static_cast<double>(image[at]) / 1000 / expected, 1, 1e-3) << x << " " << y;
    }
  }
}

// Against the sum over all pixels, of an image that is neither square nor even: nothing comes round its borders.
TEST(StrayLight, IsTheSumOverAllPixels) {
  Camera camera = test::square_camera(37, 20);
  camera.height = 22, camera.fy *= 1.3;
  const StrayLight& s = kLaws[0];
  const ScatteredLight scattered(s, camera);
  std::vector<float> image;
  for (int i = 0; i < camera.width * camera.height; ++i) image.push_back(static_cast<float>(i * 7919 % 101));
  std::vector<float> out = image;
  scattered.apply(out);
  for (const auto& [x, y] : {std::pair{0, 0}, {36, 21}, {36, 0}, {11, 13}}) {
    double sum = 0;
    for (int v = 0; v < camera.height; ++v)
      for (int u = 0; u < camera.width; ++u)
        sum +=
            static_cast<double>(image[static_cast<std::size_t>(v * camera.width + u)]) * scattered.weight(x - u, y - v);
    const auto at = static_cast<std::size_t>(y * camera.width + x);
    sum += (1 - ScatteredLight::share(s)) * static_cast<double>(image[at]);
    EXPECT_NEAR(static_cast<double>(out[at]) / sum, 1, 1e-6);
  }
}

TEST(StrayLight, IsKeptFromFrameToFrame) {
  RenderCache kept(nullptr, std::size_t{64} << 20, 1);
  Camera camera = test::square_camera(64, 20);
  StrayLight s = kLaws[0];
  const auto first = kept.scattered(s, camera, {});
  EXPECT_GE(first->bytes(), 64 * 128 * sizeof(double));
  EXPECT_EQ(kept.bytes(), first->bytes());
  s.sun_within_deg = 30, camera.cx += 5;  // of no influence
  EXPECT_EQ(kept.scattered(s, camera, {}), first);
  camera.fy *= 1.01;
  EXPECT_NE(kept.scattered(s, camera, {}), first);
  EXPECT_NE(kept.scattered(kLaws[1], test::square_camera(64, 20), {}), first);
  EXPECT_EQ(kept.bytes(), 3 * first->bytes());
  // What does not fit is made each time, and not kept.
  RenderCache little(nullptr, 8 * first->bytes() - 8, 1);
  little.scattered(s, camera, {});
  little.settle();
  little.scattered(kLaws[1], camera, {});
  EXPECT_LE(little.bytes(), first->bytes());
}

class GlareOfTheSun : public test::MoonWithoutRelief {
 protected:
  // From 2000 km above the Moon, away from it; the Sun stands beside the image.
  static FrameRequest beside_the_sun(double sun_deg) {
    FrameRequest request = test::blank_request();
    request.visibility = Visibility::automatic;
    request.camera = test::square_camera(64, 10);
    const Vec3 place = to_cartesian({20, 30, 2e6}), up = place.normalized();
    request.pose = test::looking(place, up, Vec3::unit_z());
    const View view(request.camera, request.pose);
    request.sun.direction = std::cos(sun_deg * kRadiansPerDegree) * up +
                            std::sin(sun_deg * kRadiansPerDegree) * view.moon_from_camera().col(0);
    request.band = Band(0.55, 0.01);
    SensorModel sensor;
    sensor.optics.f_number = 4;
    sensor.optics.stray_light = {1, 0.01, -1.5, 40};
    sensor.detector.pixel_pitch_um = 10, sensor.detector.quantum_efficiency = 0.5,
    sensor.detector.integration_time_s = 0.001;
    sensor.detector.photon_noise = false, sensor.detector.bit_depth = 16, sensor.detector.gain_e_dn = 1;
    request.sensor = sensor;
    request.products = kImage;
    return request;
  }
};

TEST_F(GlareOfTheSun, IsTheLawTimesItsIrradiance) {
  const FrameRequest request = beside_the_sun(30);
  const Frame frame = renderer().render(request);
  const View view(request.camera, request.pose);
  for (const auto& [x, y] : {std::pair{0, 0}, {63, 0}, {31, 32}, {63, 63}}) {
    const Vec3 ray = view.moon_from_camera().transpose() * view.ray(x, y)->normalized(),
               sun = view.moon_from_camera().transpose() * request.sun.direction;
    const double apart = std::hypot(ray.x() - sun.x(), ray.y() - sun.y());
    const double radiance = std::pow(1 + apart * apart / 1e-4, -0.75) * std::cos(30 * kRadiansPerDegree) *
                            solar_irradiance_w_m2_um(0.55) * 0.01;
    EXPECT_GE(frame.report.glare_w_m2_sr / radiance, 0.999);
    const double expected = radiance * pi * 1e-10 / 4 / 16 * 0.5 * 0.001 * 0.55e-6 / (kPlanck_j_s * kSpeedOfLight_m_s);
    EXPECT_GT(expected, 100);
    EXPECT_NEAR(frame.products.image[static_cast<std::size_t>(y * 64 + x)] / expected, 1, 0.01) << x << " " << y;
  }
  EXPECT_NEAR(frame.report.scattered_fraction, ScatteredLight::share(request.sensor->optics.stray_light), 1e-12);
}

TEST_F(GlareOfTheSun, EndsAtItsAngleInTheFieldAndBehindTheMoon) {
  EXPECT_EQ(renderer().render(beside_the_sun(41)).report.glare_w_m2_sr, 0);
  EXPECT_EQ(renderer().render(beside_the_sun(3)).report.glare_w_m2_sr,
            0);  // what is in the field is scattered from there
  FrameRequest request = beside_the_sun(30);
  const double free = renderer().render(request).report.glare_w_m2_sr;
  // Half of the Sun behind the limb, and all of it: the limb is that far below the horizontal.
  const Vec3 place = request.pose.position_m, up = place.normalized();
  const double limb_deg = 90 + std::acos(kMoonRadius_m / place.norm()) * kDegreesPerRadian;
  const Mat3 axes = View(request.camera, request.pose).moon_from_camera();
  const auto toward = [&](double from_up_deg) {
    const double angle = from_up_deg * kRadiansPerDegree;
    return Vec3(std::cos(angle) * up + std::sin(angle) * axes.col(0));
  };
  for (const auto& [lower_deg, share] : {std::pair{-1.0, 1.0}, {0.0, 0.5}, {1.0, 0.0}}) {
    request.sun.direction = toward(limb_deg + lower_deg);
    request.pose = test::looking(place, toward(limb_deg + lower_deg - 30), -axes.col(1));
    EXPECT_NEAR(renderer().render(request).report.glare_w_m2_sr / free, share, 0.02) << lower_deg;
  }
}

}  // namespace
}  // namespace selenograph::engine
