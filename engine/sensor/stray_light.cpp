#include "engine/sensor/stray_light.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <span>
#include <unsupported/Eigen/FFT>

#include "dem/base/parallel.h"
#include "engine/camera/projection.h"

namespace selenograph::engine {
namespace {

using Complex = std::complex<double>;
using std::numbers::pi;

constexpr std::size_t kLines = 32;  // rows or columns of a parallel piece

// Returns Harvey and Shack's law, sr-1. `square`: squared difference of direction cosines.
double bsdf(const StrayLight& law, double square) {
  return law.b0_sr * std::pow(1 + square / (law.shoulder * law.shoulder), law.slope / 2);
}

// Returns the law's integral over a circle of direction cosines.
double scattered_within(const StrayLight& law, double sine) {
  const double at = std::log1p(sine * sine / (law.shoulder * law.shoulder)), power = law.slope / 2 + 1;
  const double rise = std::abs(power) < 1e-9 ? at : std::expm1(power * at) / power;
  return pi * law.b0_sr * law.shoulder * law.shoulder * rise;
}

// Returns the smallest size of a fast transform from `min_size` on: a multiple of 4 with the factors 2, 3 and 5 only.
int fast_size(int min_size) {
  for (int n = (min_size + 3) / 4 * 4;; n += 4) {
    int cofactor = n;
    for (const int factor : {2, 3, 5})
      while (cofactor % factor == 0) cofactor /= factor;
    if (cofactor == 1) return n;
  }
}

// A two-dimensional transform of a real image. Only half of the frequencies along rows are stored, column by column:
// the others are their complex conjugates.
struct Frequencies {
  Frequencies(int wide, int high)
      : columns(static_cast<std::size_t>(wide)),
        rows(static_cast<std::size_t>(high)),
        half(columns / 2 + 1),
        values(half * rows) {}

  // Transforms an image. row(y, out) fills row y, for the first `filled_rows` rows; the others are 0.
  template <typename Row>
  void transform(std::size_t filled_rows, const Row& row, const StopToken& stop) {
    in_parallel_pieces(filled_rows, kLines, [&](std::size_t first, std::size_t past_last) {
      Eigen::FFT<double> fft;
      fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
      std::vector<double> in(columns);
      std::vector<Complex> out(half);
      for (std::size_t y = first; y < past_last; ++y) {
        stop.check();
        std::fill(in.begin(), in.end(), 0.0);
        row(y, in.data());
        fft.fwd(out.data(), in.data(), static_cast<Eigen::Index>(columns));
        for (std::size_t k = 0; k < half; ++k) values[k * rows + y] = out[k];
      }
    });
    for_columns([&](Eigen::FFT<double>& fft, const Complex* in,
                    Complex* out) { fft.fwd(out, in, static_cast<Eigen::Index>(rows)); },
                stop);
  }

  // Transforms back. row(y, in) receives row y of the image, for the first `needed_rows` rows.
  template <typename Row>
  void transform_back(std::size_t needed_rows, const Row& row, const StopToken& stop) {
    for_columns([&](Eigen::FFT<double>& fft, const Complex* in,
                    Complex* out) { fft.inv(out, in, static_cast<Eigen::Index>(rows)); },
                stop);
    in_parallel_pieces(needed_rows, kLines, [&](std::size_t first, std::size_t past_last) {
      Eigen::FFT<double> fft;
      fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
      std::vector<Complex> in(half);
      std::vector<double> out(columns);
      for (std::size_t y = first; y < past_last; ++y) {
        stop.check();
        for (std::size_t k = 0; k < half; ++k) in[k] = values[k * rows + y];
        fft.inv(out.data(), in.data(), static_cast<Eigen::Index>(columns));
        row(y, out.data());
      }
    });
  }

  std::size_t columns, rows, half;
  std::vector<Complex> values;

 private:
  template <typename Work>
  void for_columns(const Work& work, const StopToken& stop) {
    in_parallel_pieces(half, kLines, [&](std::size_t first, std::size_t past_last) {
      Eigen::FFT<double> fft;
      std::vector<Complex> out(rows);
      for (std::size_t k = first; k < past_last; ++k) {
        stop.check();
        work(fft, &values[k * rows], out.data());
        std::copy(out.begin(), out.end(), values.begin() + static_cast<std::ptrdiff_t>(k * rows));
      }
    });
  }
};

}  // namespace

double ScatteredLight::share(const StrayLight& law) { return scattered_within(law, 1); }

ScatteredLight::ScatteredLight(const StrayLight& law, const Camera& camera, const StopToken& stop)
    : law_(law),
      share_(share(law)),
      width_(camera.width),
      height_(camera.height),
      fx_(camera.fx),
      fy_(camera.fy),
      columns_(fast_size(2 * camera.width - 1)),
      rows_(fast_size(2 * camera.height - 1)) {
  // Compute one quadrant of the kernel; the other three are its mirror images.
  const auto w = static_cast<std::size_t>(width_), h = static_cast<std::size_t>(height_);
  std::vector<double> quadrant(w * h);
  in_parallel_pieces(h, kLines, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t y = first; y < past_last; ++y) {
      stop.check();
      for (std::size_t x = 0; x < w; ++x) quadrant[y * w + x] = weight(static_cast<int>(x), static_cast<int>(y));
    }
  });
  // Offsets of both signs are laid out cyclically: column columns - dx stands for -dx. A symmetric kernel has a real
  // transform.
  Frequencies kernel(columns_, rows_);
  const std::size_t rows = kernel.rows, columns = kernel.columns;
  kernel.transform(
      rows,
      [&](std::size_t y, double* out) {
        const std::size_t dy = std::min(y, rows - y);
        if (dy >= h) return;  // padding, which is zero
        for (std::size_t x = 0; x < columns; ++x)
          if (const std::size_t dx = std::min(x, columns - x); dx < w) out[x] = quadrant[dy * w + dx];
      },
      stop);
  transfer_.reserve(kernel.values.size());
  for (const Complex& value : kernel.values) transfer_.push_back(value.real());
}

// Integrates the law over a pixel. A point (x, y) on the plane z = 1 has the solid angle cos^3 dx dy, foreshortened
// cos^4 dx dy.
double ScatteredLight::weight(int dx, int dy) const {
  if (dx == 0 && dy == 0) return weight_of_centre();
  // Gauss-Legendre nodes in a pixel (one half of each symmetric pair): 2 x 2, or 8 x 8 near the centre, where the law
  // is steep.
  static constexpr double kNodes2[] = {0.2886751345948129}, kWeights2[] = {0.5};
  static constexpr double kNodes8[] = {0.0917173212478249, 0.2627662049581645, 0.3983332387068134, 0.4801449282487682},
                          kWeights8[] = {0.1813418916891810, 0.1568533229389436, 0.1111905172266872,
                                         0.0506142681451881};
  const bool is_steep = std::max(std::abs(dx), std::abs(dy)) <= 8;
  const auto nodes = is_steep ? std::span<const double>(kNodes8) : kNodes2,
             weights = is_steep ? std::span<const double>(kWeights8) : kWeights2;
  double sum = 0;
  for (std::size_t j = 0; j < 2 * nodes.size(); ++j)
    for (std::size_t i = 0; i < 2 * nodes.size(); ++i) {
      const double x = (dx + (i % 2 ? -1 : 1) * nodes[i / 2]) / fx_, y = (dy + (j % 2 ? -1 : 1) * nodes[j / 2]) / fy_;
      const double tangent2 = x * x + y * y, cos2 = 1 / (1 + tangent2);
      sum += weights[i / 2] * weights[j / 2] * bsdf(law_, tangent2 * cos2) * cos2 * cos2;
    }
  return sum / (fx_ * fy_);
}

// Integrates the law over the centre's pixel, where it is steepest: in each direction there is a closed form up to the
// pixel's border.
double ScatteredLight::weight_of_centre() const {
  constexpr int kDirections = 512;
  double sum = 0;
  for (int i = 0; i < kDirections; ++i) {
    const double angle = pi / 2 * (i + 0.5) / kDirections,
                 tangent = std::min(0.5 / (fx_ * std::cos(angle)), 0.5 / (fy_ * std::sin(angle)));
    sum += scattered_within(law_, tangent / std::hypot(1, tangent));
  }
  return sum / kDirections;
}

void ScatteredLight::apply(std::vector<float>& image, const StopToken& stop) const {
  Frequencies light(columns_, rows_);
  const auto w = static_cast<std::size_t>(width_), h = static_cast<std::size_t>(height_);
  light.transform(
      h, [&](std::size_t y, double* out) { std::copy_n(&image[y * w], w, out); }, stop);
  for (std::size_t i = 0; i < transfer_.size(); ++i) light.values[i] *= transfer_[i];
  light.transform_back(
      h,
      [&](std::size_t y, const double* in) {
        for (std::size_t x = 0; x < w; ++x) {
          float& pixel = image[y * w + x];
          pixel = static_cast<float>((1 - share_) * static_cast<double>(pixel) + std::max(0.0, in[x]));
        }
      },
      stop);
}

double add_glare(const StrayLight& law, const Camera& camera, const Vec3& toward_sun, double irradiance_w_m2,
                 std::vector<float>& image, const StopToken& stop) {
  const Projection projection(camera);
  const int width = camera.width;
  const std::size_t rows = image.size() / static_cast<std::size_t>(width);
  std::vector<float> largest(rows, 0.F);
  in_parallel_pieces(rows, kLines, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t y = first; y < past_last; ++y) {
      stop.check();
      for (int x = 0; x < width; ++x) {
        const auto direction = projection.direction(x, static_cast<double>(y));
        if (!direction) continue;
        const Vec3 along = direction->normalized();
        const auto glare =
            static_cast<float>(irradiance_w_m2 * toward_sun.z() * bsdf(law, (along - toward_sun).xy().squared_norm()));
        image[y * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)] += glare;
        largest[y] = std::max(largest[y], glare);
      }
    }
  });
  return static_cast<double>(*std::max_element(largest.begin(), largest.end()));
}

}  // namespace selenograph::engine
