// Point spread and vignetting against closed forms.
#include "engine/sensor/optics.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "tests/support/processor_time.h"

namespace selenograph::engine {
namespace {

PointSpread gaussian(double sigma_px) {
  PointSpread spread;
  spread.model = PointSpread::Model::gaussian, spread.sigma_px = sigma_px;
  return spread;
}
PointSpread airy() {
  PointSpread spread;
  spread.model = PointSpread::Model::airy;
  return spread;
}

double sum_of(const SpreadKernel& kernel) {
  double sum = 0;
  for (int y = -kernel.radius(); y <= kernel.radius(); ++y)
    for (int x = -kernel.radius(); x <= kernel.radius(); ++x) sum += kernel.weight(x, y);
  return sum;
}

TEST(PointSpread, GaussiansHaveTheirWidth) {
  for (const double sigma : {0.01, 0.1, 0.3, 0.6, 1.5, 7.0}) {
    const SpreadKernel kernel(gaussian(sigma), 4, 5, 0.6);
    const auto share = [sigma](int x) {
      const double unit = sigma * std::numbers::sqrt2;
      return (std::erf((x + 0.5) / unit) - std::erf((x - 0.5) / unit)) / 2;
    };
    for (int y = 0; y <= kernel.radius(); ++y)
      for (int x = 0; x <= kernel.radius(); ++x) EXPECT_NEAR(kernel.weight(x, -y), share(x) * share(y), 1e-5);
    EXPECT_NEAR(sum_of(kernel), 1, 1e-6);
    EXPECT_GT(kernel.captured(), 1 - 1e-5);
    double second = 0;
    for (int y = -kernel.radius(); y <= kernel.radius(); ++y)
      for (int x = -kernel.radius(); x <= kernel.radius(); ++x) second += kernel.weight(x, y) * x * x;
    if (sigma > 1) {  // a pixel's own width adds to it
      EXPECT_NEAR(second, sigma * sigma + 1.0 / 12, 2e-3 * sigma * sigma);
    }
    EXPECT_EQ(kernel.weight(1, 2), kernel.weight(-2, 1));
  }
}

// Airy discs whose lambda N is so many pixels.
SpreadKernel airy_of(double lambda_n_px) { return SpreadKernel(airy(), 1, 1, lambda_n_px); }

// What the kernel has of a pixel without what was cut off, which is spread evenly over it.
double own_weight(const SpreadKernel& kernel, int x, int y) {
  const int side = 2 * kernel.radius() + 1;
  return kernel.weight(x, y) - (1 - kernel.captured()) / (side * side);
}

// Of a circular aperture, Goodman, Introduction to Fourier Optics, 6-32; 1 is its cut-off frequency.
double aperture_mtf(double frequency) {
  if (frequency >= 1) return 0;
  return 2 / std::numbers::pi * (std::acos(frequency) - frequency * std::sqrt(1 - frequency * frequency));
}
double sinc(double x) { return x == 0 ? 1 : std::sin(std::numbers::pi * x) / (std::numbers::pi * x); }

// A pixel's share of the light, of a point (x, y) beside its middle: its aperture and that of the optics in the
// frequency domain, which has an end, in polar coordinates.
double share_by_frequencies(double lambda_n_px, double x, double y) {
  const double end = 1 / lambda_n_px, phase = 2 * std::numbers::pi * end * (std::hypot(x, y) + 1);
  const int around = 32 + static_cast<int>(phase), outward = 200 + static_cast<int>(phase);
  double sum = 0;
  for (int i = 0; i < outward; ++i) {
    // Closer at both ends, where the MTF has kinks.
    const double s = (i + 0.5) / outward, place = s * s * (3 - 2 * s), frequency = end * place;
    double ring = 0;
    for (int k = 0; k < around; ++k) {
      const double angle = std::numbers::pi * (k + 0.5) / around, fx = frequency * std::cos(angle),
                   fy = frequency * std::sin(angle);
      ring += sinc(fx) * sinc(fy) * std::cos(2 * std::numbers::pi * (fx * x + fy * y));
    }
    sum += aperture_mtf(place) * frequency * ring / around * end * 6 * s * (1 - s) / outward;
  }
  return 2 * std::numbers::pi * sum;
}

TEST(PointSpread, AiryDiscsAreIntegratedOverPixels) {
  for (const double lambda_n_px : {0.0157, 0.016, 0.1, 0.3, 0.48, 1.0, 2.7, 8.0, 26.0}) {
    const SpreadKernel kernel = airy_of(lambda_n_px);
    EXPECT_NEAR(sum_of(kernel), 1, 2e-6);
    const int r = kernel.radius();
    for (const auto& [x, y] : {std::pair{0, 0}, {1, 0}, {1, 1}, {r, 0}, {-r, r}})
      EXPECT_NEAR(own_weight(kernel, x, y), share_by_frequencies(lambda_n_px, x, y), 5e-6)
          << lambda_n_px << ": " << x << " " << y;
  }
}

// Encircled energy 1 - J0^2 - J1^2 of v = pi r / (lambda N) (Born & Wolf 8.5.2): of the circles in and around the
// kernel's square, and, of pixels fine enough to make up a circle, of the first dark ring's.
TEST(PointSpread, AiryEncirclesItsEnergy) {
  const auto encircled = [](double v) {
    const double j0 = std::cyl_bessel_j(0.0, v), j1 = std::cyl_bessel_j(1.0, v);
    return 1 - j0 * j0 - j1 * j1;
  };
  for (const double lambda_n_px : {0.0157, 0.016, 0.1, 0.48, 1.0, 2.7, 8.0, 26.0}) {
    const SpreadKernel kernel = airy_of(lambda_n_px);
    const double half = std::numbers::pi * (kernel.radius() + 0.5) / lambda_n_px;
    EXPECT_GT(kernel.captured(), encircled(half)) << lambda_n_px;
    EXPECT_LT(kernel.captured(), encircled(half * std::numbers::sqrt2)) << lambda_n_px;
  }
  const SpreadKernel kernel = airy_of(8);
  EXPECT_EQ(kernel.radius(), SpreadKernel::kMaxRadius);
  double within = 0;
  for (int y = -14; y <= 14; ++y)
    for (int x = -14; x <= 14; ++x)
      if (std::hypot(x, y) <= 9.76) within += own_weight(kernel, x, y);
  EXPECT_NEAR(within, encircled(1.22 * std::numbers::pi), 0.001);  // the first dark ring, 1.22 lambda N, holds 83.8 %
}

TEST(PointSpread, StopsAtTheDeadline) {
  const auto stops = [](const auto& work) {
    const StopToken soon(StopToken::Clock::now() + std::chrono::milliseconds(50));
    EXPECT_LT(test::processor_s_per_core([&] { EXPECT_THROW(work(soon), Cancelled); }), 0.05 + 0.45);
  };
  stops([](const StopToken& stop) {
    for (;;) SpreadKernel(airy(), 1, 1, 0.00501 * std::numbers::pi, stop);
  });
  PointSpread measured;
  measured.model = PointSpread::Model::kernel;
  measured.side = 65, measured.kernel.assign(65 * 65, 1);
  std::vector<float> out;
  for (const PointSpread& spread : {measured, gaussian(7)}) {
    const SpreadKernel kernel(spread, 4, 5, 0.6);
    const int border = 2 * kernel.radius();
    const std::vector<float> in(static_cast<std::size_t>((4096 + border) * (1024 + border)), 1.F);
    stops([&](const StopToken& stop) {
      for (;;) kernel.apply(in, 4096, 1024, out, stop);
    });
  }
}

// Everything that the kernel holds arrives, wherever a point is, and turned the right way.
TEST(PointSpread, AMeasuredKernelIsLeftByAPoint) {
  PointSpread spread;
  spread.model = PointSpread::Model::kernel;
  spread.side = 3, spread.kernel = {1, 2, 3, 4, 20, 5, 6, 7, 2};
  const SpreadKernel kernel(spread, 4, 5, 0.6);
  const int r = kernel.radius(), wide = 5 + 2 * r;
  std::vector<float> in(static_cast<std::size_t>(wide * (4 + 2 * r)), 0.F), out;  // 5 x 4 and the kernel's border
  in[static_cast<std::size_t>((1 + r) * wide + 2 + r)] = 100.F;                   // pixel (2, 1)
  kernel.apply(in, 5, 4, out);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 5; ++x) {
      const int dx = x - 2, dy = y - 1;
      const double expected =
          std::abs(dx) > 1 || std::abs(dy) > 1 ? 0 : 2 * spread.kernel[static_cast<std::size_t>((dy + 1) * 3 + dx + 1)];
      EXPECT_NEAR(static_cast<double>(out[static_cast<std::size_t>(y * 5 + x)]), expected, 1e-4) << x << ' ' << y;
    }
}

TEST(PointSpread, EvenLightStaysEvenUpToTheBorder) {
  for (const PointSpread& spread : {gaussian(1.2), airy()}) {
    const SpreadKernel kernel(spread, 5.6, 5, 0.6);
    const int r = kernel.radius();
    const std::vector<float> in(static_cast<std::size_t>((40 + 2 * r) * (30 + 2 * r)), 5.F);
    std::vector<float> out;
    kernel.apply(in, 40, 30, out);
    ASSERT_EQ(out.size(), 1200U);
    for (const float x : out) EXPECT_NEAR(static_cast<double>(x), 5, 2e-5);
  }
}

// A straight edge becomes the error function.
TEST(PointSpread, AnEdgeIsBlurredToTheClosedForm) {
  const double sigma = 1.5;
  const SpreadKernel kernel(gaussian(sigma), 4, 5, 0.6);
  const int r = kernel.radius(), wide = 41 + 2 * r;
  std::vector<float> in(static_cast<std::size_t>(wide * (5 + 2 * r))), out;
  for (std::size_t i = 0; i < in.size(); ++i) in[i] = static_cast<int>(i) % wide < r + 20 ? 1.F : 0.F;
  kernel.apply(in, 41, 5, out);
  for (int x = 0; x < 41; ++x) {
    // Pixels up to 19, the differences of whose shares add up.
    const double expected = 0.5 * std::erfc((x - 19.5) / (sigma * std::numbers::sqrt2));
    EXPECT_NEAR(static_cast<double>(out[static_cast<std::size_t>(2 * 41 + x)]), expected, 2e-5) << x;
  }
}

TEST(Vignetting, FollowsTheAngle) {
  Camera camera;
  camera.width = 101, camera.height = 81, camera.fx = camera.fy = 60, camera.cx = 50, camera.cy = 40;
  Vignetting cos4, table;
  cos4.model = Vignetting::Model::cos4;
  table.model = Vignetting::Model::table;
  table.table = {{5, 1}, {25, 0.8}, {35, 0.2}};
  std::vector<float> a(101 * 81, 2.F), b = a;
  vignette(cos4, camera, {}, a), vignette(table, camera, {}, b);
  for (int y = 0; y < 81; ++y)
    for (int x = 0; x < 101; ++x) {
      const double angle = std::atan(std::hypot(x - 50, y - 40) / 60.0), degrees = angle * 180 / std::numbers::pi;
      const double expected = degrees < 5    ? 1
                              : degrees < 25 ? 1 - 0.2 * (degrees - 5) / 20
                              : degrees < 35 ? 0.8 - 0.6 * (degrees - 25) / 10
                                             : 0.2;
      EXPECT_NEAR(a[static_cast<std::size_t>(y * 101 + x)], 2 * std::pow(std::cos(angle), 4), 1e-6);
      EXPECT_NEAR(b[static_cast<std::size_t>(y * 101 + x)], 2 * expected, 1e-6);
    }
}

PointSpread measured() {
  PointSpread spread;
  spread.model = PointSpread::Model::kernel, spread.side = 7;
  for (int y = -3; y <= 3; ++y)
    for (int x = -3; x <= 3; ++x) spread.kernel.push_back(std::exp(-0.7 * (x * x + y * y)));
  return spread;
}

PointSpread measured(int side, std::vector<double> kernel) {
  PointSpread spread;
  spread.model = PointSpread::Model::kernel, spread.side = side, spread.kernel = std::move(kernel);
  return spread;
}

// A Gaussian that is cut off where it is far from zero.
PointSpread cut_gaussian(int side, double sigma_px) {
  std::vector<double> kernel;
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x)
      kernel.push_back(
          std::exp(-0.5 * (std::pow(x - side / 2, 2) + std::pow(y - side / 2, 2)) / (sigma_px * sigma_px)));
  return measured(side, std::move(kernel));
}

// deploy/assets/kernels/made-up-coma.csv
PointSpread coma() {
  return measured(7,
                  {0,    0,    0,    0,    0.02, 0.01, 0,    0,    0,    0.02, 0.05, 0.06, 0.04, 0.02, 0,    0.02, 0.10,
                   0.30, 0.20, 0.10, 0.04, 0.01, 0.05, 0.35, 1.00, 0.45, 0.18, 0.07, 0,    0.02, 0.10, 0.30, 0.20, 0.10,
                   0.04, 0,    0,    0.02, 0.05, 0.06, 0.04, 0.02, 0,    0,    0,    0,    0.02, 0.01, 0});
}

struct Moments {
  double sum = 0, x = 0, y = 0;
};

Moments moments_of(const SpreadKernel& kernel) {
  Moments m;
  for (int y = -kernel.radius(); y <= kernel.radius(); ++y)
    for (int x = -kernel.radius(); x <= kernel.radius(); ++x) {
      const double weight = kernel.weight(x, y);
      m.sum += weight, m.x += x * weight, m.y += y * weight;
    }
  return m;
}

// Kernels with light on their border keep it: a shift moves it out of the measured square.
TEST(PointSpread, ShiftedMeasuredKernelsKeepLightAndMoveByTheirShift) {
  for (const PointSpread& spread : {measured(1, {3}), cut_gaussian(3, 1), cut_gaussian(7, 3), cut_gaussian(65, 30),
                                    coma(), measured(3, {1, 2, 3, 4, 20, 5, 6, 7, 2})}) {
    const SpreadKernel centered(spread, 4, 5, 0.6);
    const Moments own = moments_of(centered);
    EXPECT_NEAR(own.sum, 1, 1e-6);
    for (const double dx : {-0.5, -0.375, -0.25, -0.125, 0.0, 0.0625, 0.25, 0.49, 0.5})
      for (const double dy : {-0.46875, 0.0, 0.25, 0.5}) {
        const Moments shifted = moments_of(centered.shifted(spread, dx, dy));
        EXPECT_NEAR(shifted.sum, 1, 1e-6) << spread.side << ": " << dx << ' ' << dy;
        EXPECT_NEAR(shifted.x, own.x + dx, 1e-6) << spread.side << ": " << dx << ' ' << dy;
        EXPECT_NEAR(shifted.y, own.y + dy, 1e-6) << spread.side << ": " << dx << ' ' << dy;
      }
  }
}

// A point beside its pixel's center leaves an image that is centered on it; all of its light.
TEST(PointSpread, ShiftedKernelsAreCenteredOnTheirPoint) {
  for (const PointSpread& spread : {gaussian(0.6), gaussian(2), airy(), measured()})
    for (const double dx : {-0.375, 0.0, 0.125, 0.46875})
      for (const double dy : {-0.46875, 0.0, 0.25}) {
        const SpreadKernel centered(spread, 4, 5, 0.6), kernel = centered.shifted(spread, dx, dy);
        EXPECT_EQ(kernel.radius(), centered.radius()) << "as wide a margin";
        EXPECT_NEAR(sum_of(kernel), 1, 1e-6);
        if (dx == 0 && dy == 0) {
          for (int x = -kernel.radius(); x <= kernel.radius(); ++x)
            EXPECT_NEAR(kernel.weight(x, 1), centered.weight(x, 1), 2e-4);
        }
        if (spread.model == PointSpread::Model::airy) continue;  // too narrow: see below
        double x_mean = 0, y_mean = 0;
        for (int y = -kernel.radius(); y <= kernel.radius(); ++y)
          for (int x = -kernel.radius(); x <= kernel.radius(); ++x)
            x_mean += x * kernel.weight(x, y), y_mean += y * kernel.weight(x, y);
        EXPECT_NEAR(x_mean, dx, 0.01);
        EXPECT_NEAR(y_mean, dy, 0.01);
      }
}

TEST(PointSpread, ShiftedAiryDiscsAreIntegratedOverPixels) {
  for (const double lambda_n_px : {0.016, 0.1, 0.48, 1.0, 2.7})
    for (const auto& [dx, dy] : {std::pair{0.375, -0.125}, {-0.5, 0.5}}) {
      const SpreadKernel kernel = airy_of(lambda_n_px).shifted(airy(), dx, dy);
      EXPECT_NEAR(sum_of(kernel), 1, 2e-6);
      // Opposite pixels together: the slope of what was cut off is not in their sum.
      for (const auto& [x, y] : {std::pair{0, 0}, {1, 0}, {0, -1}, {-1, 1}})
        EXPECT_NEAR(
            own_weight(kernel, x, y) + own_weight(kernel, -x, -y),
            share_by_frequencies(lambda_n_px, x - dx, y - dy) + share_by_frequencies(lambda_n_px, -x - dx, -y - dy),
            1e-5)
            << lambda_n_px << ": " << x << " " << y;
    }
}

// The mean place of all of a disc's light, column by column. Of a disc that pixels sample it is the point's place; of a
// narrower one it is not, as in a camera.
TEST(PointSpread, ShiftedAiryDiscsHaveTheMeanPlaceOfTheirLight) {
  const auto column = [](double lambda_n_px, double x) {
    constexpr int kSteps = 4000;
    double sum = 0;
    for (int i = 0; i < kSteps; ++i) {
      const double s = (i + 0.5) / kSteps, frequency = s / lambda_n_px;
      sum += 2 * aperture_mtf(s) * sinc(frequency) * std::cos(2 * std::numbers::pi * frequency * x);
    }
    return sum / kSteps / lambda_n_px;
  };
  for (const double lambda_n_px : {0.1, 0.48, 0.7, 1.0, 2.7, 26.0})
    for (const auto& [dx, dy] : {std::pair{0.375, -0.125}, {-0.5, 0.3}}) {
      const SpreadKernel kernel = airy_of(lambda_n_px).shifted(airy(), dx, dy);
      double mean_x = 0, mean_y = 0, expected = lambda_n_px < 1 ? 0 : dx;
      for (int y = -kernel.radius(); y <= kernel.radius(); ++y)
        for (int x = -kernel.radius(); x <= kernel.radius(); ++x)
          mean_x += x * kernel.weight(x, y), mean_y += y * kernel.weight(x, y);
      for (int x = -60; lambda_n_px < 1 && x <= 60; ++x) expected += x * column(lambda_n_px, x - dx);
      EXPECT_NEAR(mean_x, expected, lambda_n_px < 1 ? 3e-3 : 1e-4) << lambda_n_px << " " << dx;
      if (lambda_n_px < 1) continue;
      EXPECT_NEAR(mean_y, dy, 1e-4) << lambda_n_px << " " << dy;
    }
}

// An image of n x n samples a pixel, spread sample by sample. sample(x, y): in pixels, of all of it.
template <typename Sample>
std::vector<float> spread_by_samples(const PointSpread& spread, int width, int height, int n, const Sample& sample) {
  const SpreadKernel centered(spread, 4, 5, 0.6);
  const int r = centered.radius();
  std::vector<float> image(static_cast<std::size_t>(width * height), 0.F), part, out;
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) {
      const double dx = (i + 0.5) / n - 0.5, dy = (j + 0.5) / n - 0.5;
      part.clear();
      for (int y = -r; y < height + r; ++y)
        for (int x = -r; x < width + r; ++x) part.push_back(static_cast<float>(sample(x + dx, y + dy)));
      centered.shifted(spread, dx, dy).apply(part, width, height, out);
      for (std::size_t k = 0; k < out.size(); ++k) image[k] += out[k] / static_cast<float>(n * n);
    }
  return image;
}

// What the kernel cuts off costs the MTF little where it is spread evenly: normalised again, all of the MTF is 1.4 %
// too much.
TEST(PointSpread, AnAiryDiscHasTheTransferFunctionOfItsAperture) {
  constexpr double kLambdaN_px = 0.6 * 4 / 5;
  for (const double frequency : {0.125, 0.25, 0.375, 0.5}) {
    const std::vector<float> image = spread_by_samples(
        airy(), 64, 1, 4, [&](double x, double) { return 1 + std::cos(2 * std::numbers::pi * frequency * x); });
    double cosine = 0;
    for (int x = 0; x < 64; ++x)
      cosine += static_cast<double>(image[static_cast<std::size_t>(x)]) *
                std::cos(2 * std::numbers::pi * frequency * x) / (frequency < 0.5 ? 32 : 64);
    EXPECT_NEAR(cosine / sinc(frequency), aperture_mtf(frequency * kLambdaN_px), 0.004) << frequency;
  }
}

// The pixel's aperture counts once: MTF at 0.25 cycles a pixel is exp(-2 pi^2 sigma^2 f^2) sinc(f) = 0.577 for 0.6 px.
// (Spread as pixels' means: 0.524.)
TEST(PointSpread, OfSamplesHasTheTransferFunctionOfOneAperture) {
  constexpr double kFrequency = 0.25, kSigma = 0.6;
  const std::vector<float> image = spread_by_samples(
      gaussian(kSigma), 64, 1, 4, [](double x, double) { return 1 + std::cos(2 * std::numbers::pi * kFrequency * x); });
  double cosine = 0;
  for (int x = 0; x < 64; ++x)
    cosine += 2 * static_cast<double>(image[static_cast<std::size_t>(x)]) *
              std::cos(2 * std::numbers::pi * kFrequency * x) / 64;
  const double expected =
      std::exp(-2 * std::numbers::pi * std::numbers::pi * kSigma * kSigma * kFrequency * kFrequency) *
      std::sin(std::numbers::pi * kFrequency) / (std::numbers::pi * kFrequency);
  EXPECT_NEAR(expected, 0.577, 0.001);
  EXPECT_NEAR(cosine, expected, 0.002);
}

// A source of half a pixel: its centroid is where it stands. (Spread as pixels' means: off by up to 0.21 px.)
TEST(PointSpread, OfSamplesKeepsCentroids) {
  constexpr int kSide = 33;
  for (const int n : {2, 4})
    for (const PointSpread& spread : {gaussian(0.6), measured(), measured(1, {1}), cut_gaussian(3, 1)})
      for (double at = 16; at < 17; at += 0.07) {
        // Each sample stands for its share of the pixel.
        const auto within = [&](double middle, double place) {
          const double low = std::max(place - 0.5 / n, middle - 0.25), high = std::min(place + 0.5 / n, middle + 0.25);
          return std::max(0.0, high - low) * n;
        };
        const std::vector<float> image = spread_by_samples(
            spread, kSide, kSide, n, [&](double x, double y) { return within(at, x) * within(16.3, y); });
        double light = 0, x_mean = 0, y_mean = 0;
        for (int y = 0; y < kSide; ++y)
          for (int x = 0; x < kSide; ++x) {
            const auto value = static_cast<double>(image[static_cast<std::size_t>(y * kSide + x)]);
            light += value, x_mean += value * x, y_mean += value * y;
          }
        EXPECT_NEAR(light, 0.25, 1e-4);
        EXPECT_NEAR(x_mean / light, at, 0.01);
        EXPECT_NEAR(y_mean / light, 16.3, 0.01);
      }
}

}  // namespace
}  // namespace selenograph::engine
