#include "engine/sensor/optics.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include "dem/base/parallel.h"
#include "dem/base/vector_targets.h"
#include "engine/support/interpolate.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/sensor/optics.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Adds weight times in[i] to out[i].
void AddWeighted(const float* in, float weight, std::size_t count, float* out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (std::size_t i = 0; i < count; ++i) out[i] += weight * in[i];
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(AddWeighted);

namespace {

void add_weighted(const float* in, float weight, std::size_t count, float* out) {
  HWY_DYNAMIC_DISPATCH(AddWeighted)(in, weight, count, out);
}

constexpr std::size_t kRows = 16;  // rows of a parallel piece

// Below this unit an Airy disc's rings are much finer than a pixel. Neighbouring pixels then get the mean of the far
// rings, which differs by 1e-6 of the light from integration over every ring (tests/unit/optics_test.cpp) and needs no
// quadrature, while the points for integration grow without bound.
constexpr double kFarAiry_px = 0.005;

// Returns the weights of a Gaussian along one axis, integrated over pixels, for a point at an offset from its pixel's
// center. Sets `captured` to the share of the light in the square of this radius, for equal weights along both axes.
std::vector<float> gaussian(double sigma_px, int radius, double& captured, double offset_px = 0) {
  std::vector<float> weights;
  const auto below = [&](double x) { return 0.5 * std::erfc(-(x - offset_px) / (sigma_px * std::numbers::sqrt2)); };
  const double sum = below(radius + 0.5) - below(-radius - 0.5);
  for (int i = -radius; i <= radius; ++i)
    weights.push_back(static_cast<float>((below(i + 0.5) - below(i - 0.5)) / sum));
  captured = sum * sum;
  return weights;
}

// Returns the Airy disc (2 J1(v) / v)^2, normalised to a total of 1 (Born & Wolf, Principles of Optics, 8.5.2). v:
// distance in units of lambda N / pi.
double airy(double v) {
  const double bessel = v > 1e-6 ? 2 * std::cyl_bessel_j(1.0, v) / v : 1;
  return bessel * bessel / (4 * std::numbers::pi);
}

// Returns the centroid of a whole Airy disc, integrated over pixels and each pixel taken at its center, for a point at
// an offset. It is the offset plus the aliases that sampling folds back at k cycles per pixel: the ideal aperture's
// transfer function, up to its cut-off at p / (lambda N).
double airy_mean_px(double offset_px, double unit_px) {
  double mean = offset_px;
  for (int k = 1; k * std::numbers::pi * unit_px < 1; ++k) {
    const double relative_frequency = k * std::numbers::pi * unit_px;
    const double transfer =
        (std::acos(relative_frequency) - relative_frequency * std::sqrt(1 - relative_frequency * relative_frequency)) *
        2 / std::numbers::pi;
    mean += (k % 2 ? -1 : 1) * transfer * std::sin(2 * std::numbers::pi * k * offset_px) / (std::numbers::pi * k);
  }
  return mean;
}

// Gauss-Legendre quadrature over a pixel, from -1/2 to 1/2: Newton's iteration from Tricomi's estimate of the roots.
struct PixelQuadrature {
  std::vector<double> nodes, weights;
  explicit PixelQuadrature(int points) {
    for (int i = 0; i < points; ++i) {
      double x = std::cos(std::numbers::pi * (i + 0.75) / (points + 0.5)), slope = 1;
      for (int step = 0; step < 5; ++step) {
        double before = 1, at = x;
        for (int n = 2; n <= points; ++n) before = std::exchange(at, ((2 * n - 1) * x * at - (n - 1) * before) / n);
        slope = points * (x * at - before) / (x * x - 1);
        x -= at / slope;
      }
      nodes.push_back(x / 2);
      weights.push_back(1 / ((1 - x * x) * slope * slope));
    }
  }
};

}  // namespace

// A table of airy() in steps of 1/16, interpolated by the cubic through four values: within 1e-6 of the central value.
class AiryTable {
 public:
  AiryTable(double last_v, const StopToken& stop) {
    for (std::size_t i = 0; i < static_cast<std::size_t>(last_v / kStep) + 4; ++i) {
      stop.check();
      values_.push_back(airy(static_cast<double>(i) * kStep));
    }
  }
  double operator()(double v) const {
    const double at = v / kStep;
    // The disc is an even function: the value before the first is the second.
    const auto i = static_cast<std::size_t>(at);
    const double t = at - static_cast<double>(i), before = values_[i > 0 ? i - 1 : 1], here = values_[i],
                 after = values_[i + 1];
    const double bend = after - 2 * here + before, third = values_[i + 2] - 3 * after + 3 * here - before;
    return here + t / 2 * (after - before + t * bend + (t * t - 1) / 3 * third);
  }

 private:
  static constexpr double kStep = 0.0625;
  std::vector<double> values_;
};

SpreadKernel::SpreadKernel(const PointSpread& spread, double f_number, double pixel_pitch_um, double wavelength_um,
                           const StopToken& stop) {
  switch (spread.model) {
    case PointSpread::Model::none:
      row_ = column_ = {1.F};
      return;
    case PointSpread::Model::gaussian:
      radius_ = std::min(kMaxRadius, static_cast<int>(std::ceil(4.5 * spread.sigma_px)));
      row_ = column_ = gaussian(spread.sigma_px, radius_, captured_);
      return;
    case PointSpread::Model::airy: {
      const double unit_px = unit_px_ = wavelength_um * f_number / std::numbers::pi / pixel_pitch_um;
      if (unit_px < kFarAiry_px) {
        spread_far_airy(unit_px);
        return;
      }
      // Rings are lambda N wide. 12 of them contain 98.4 % of the light; fewer if they do not fit into kMaxRadius.
      radius_ = std::clamp(static_cast<int>(std::ceil(12 * std::numbers::pi * unit_px)), 1, kMaxRadius);
      airy_ = std::make_shared<const AiryTable>(std::numbers::sqrt2 * (radius_ + 1) / unit_px, stop);
      spread_airy(0, 0, stop);
      return;
    }
    case PointSpread::Model::kernel:
      use_measured(spread);
      return;
  }
}

// Uses a measured kernel. A shifted kernel reaches one pixel farther, so a kernel with light on its border gets a ring
// of zeros: without it, shifting would lose that light and move the centroid.
void SpreadKernel::use_measured(const PointSpread& spread) {
  const int side = spread.side;
  const auto measured = [&](int x, int y) { return spread.kernel[static_cast<std::size_t>(y * side + x)]; };
  int ring = 0;
  for (int i = 0; i < side; ++i)
    if (measured(i, 0) != 0 || measured(i, side - 1) != 0 || measured(0, i) != 0 || measured(side - 1, i) != 0)
      ring = 1;
  radius_ = side / 2 + ring;
  const double sum = std::accumulate(spread.kernel.begin(), spread.kernel.end(), 0.0);
  const int padded_side = side + 2 * ring;
  kernel_.assign(static_cast<std::size_t>(padded_side * padded_side), 0.F);
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x)
      kernel_[static_cast<std::size_t>((y + ring) * padded_side + x + ring)] = static_cast<float>(measured(x, y) / sum);
}

void SpreadKernel::spread_airy(double dx, double dy, const StopToken& stop) {
  // J1(v)^2 oscillates as cos(2 v): integrating it over a pixel takes about half a point per unit, plus four for full
  // precision.
  const PixelQuadrature over(4 + static_cast<int>(std::ceil(0.55 / unit_px_)));
  const std::size_t points = over.nodes.size();
  const int side = 2 * radius_ + 1;
  std::vector<double> shares;
  double mean_x = 0, mean_y = 0, square = 0;
  for (int y = -radius_; y <= radius_; ++y) {
    stop.check();
    for (int x = -radius_; x <= radius_; ++x) {
      double share = 0;
      for (std::size_t j = 0; j < points; ++j) {
        const double down = y - dy + over.nodes[j];
        double row = 0;
        for (std::size_t i = 0; i < points; ++i) {
          const double across = x - dx + over.nodes[i];
          row += over.weights[i] * (*airy_)(std::sqrt(across * across + down * down) / unit_px_);
        }
        share += over.weights[j] * row;
      }
      shares.push_back(share / (unit_px_ * unit_px_));
      mean_x += x * shares.back();
      mean_y += y * shares.back();
      square += x * x;
    }
  }
  captured_ = std::accumulate(shares.begin(), shares.end(), 0.0);
  // The cut-off light is asymmetric for a shifted disc. Spread it with a slope that keeps the centroid.
  const double rest_per_pixel = (1 - captured_) / (side * side),
               slope_x = (airy_mean_px(dx, unit_px_) - mean_x) / square,
               slope_y = (airy_mean_px(dy, unit_px_) - mean_y) / square;
  kernel_.clear();
  for (int y = -radius_, i = 0; y <= radius_; ++y)
    for (int x = -radius_; x <= radius_; ++x, ++i)
      kernel_.push_back(
          static_cast<float>(shares[static_cast<std::size_t>(i)] + rest_per_pixel + slope_x * x + slope_y * y));
}

SpreadKernel SpreadKernel::shifted(const PointSpread& spread, double dx, double dy, const StopToken& stop) const {
  SpreadKernel out = *this;
  switch (spread.model) {
    case PointSpread::Model::none:
      break;
    case PointSpread::Model::gaussian: {
      double across = 1, down = 1;  // captured shares, not needed
      out.row_ = gaussian(spread.sigma_px, radius_, across, dx);
      out.column_ = gaussian(spread.sigma_px, radius_, down, dy);
      break;
    }
    case PointSpread::Model::airy:  // the finest discs stay in the point's own pixel: they have no table
      if (airy_) out.spread_airy(dx, dy, stop);
      break;
    case PointSpread::Model::kernel: {
      // Interpolate between this pixel's kernel and those of its neighbours.
      const auto at = [&](int x, int y) { return weight(x, y); };
      const int sx = dx < 0 ? -1 : 1, sy = dy < 0 ? -1 : 1;
      const double tx = std::abs(dx), ty = std::abs(dy);
      auto out_weight = out.kernel_.begin();
      for (int y = -radius_; y <= radius_; ++y)
        for (int x = -radius_; x <= radius_; ++x)
          *out_weight++ = static_cast<float>((1 - tx) * ((1 - ty) * at(x, y) + ty * at(x, y - sy)) +
                                             tx * ((1 - ty) * at(x - sx, y) + ty * at(x - sx, y - sy)));
      break;
    }
  }
  return out;
}

// Sets a 3 x 3 kernel for an Airy disc that is much finer than a pixel. Far from the centre J1(v)^2 is
// 2 / (pi v) cos^2(v - 3 pi / 4), and the rings' mean is u / (pi^2 r^3) for a unit u. The integral of 1 / r^3 over a
// rectangle is the difference of -r / (x y) at its corners.
void SpreadKernel::spread_far_airy(double unit_px) {
  // r / (x y) at corners of the pixels beside and diagonal to the middle: (1/2, 1/2), (3/2, 3/2), (1/2, 3/2).
  const double near = std::numbers::sqrt2 / 0.5, far = std::numbers::sqrt2 / 1.5, mixed = std::sqrt(2.5) / 0.75;
  const double scale = unit_px / (std::numbers::pi * std::numbers::pi);
  const double side = scale * 2 * (near - mixed), corner = scale * (2 * mixed - near - far);
  // The integral of 1 / r^3 outside a square of half-width h is 8 / (sqrt(2) h).
  captured_ = 1 - scale * 8 / (std::numbers::sqrt2 * 1.5);
  const auto weight_of = [this](double share) { return static_cast<float>(share + (1 - captured_) / 9); };
  const float s = weight_of(side), c = weight_of(corner), middle = weight_of(captured_ - 4 * (side + corner));
  radius_ = 1;
  kernel_ = {c, s, c, s, middle, s, c, s, c};
}

double SpreadKernel::weight(int dx, int dy) const {
  if (std::abs(dx) > radius_ || std::abs(dy) > radius_) return 0;
  const auto column = static_cast<std::size_t>(dx + radius_), row = static_cast<std::size_t>(dy + radius_);
  if (!row_.empty()) return static_cast<double>(row_[column]) * static_cast<double>(column_[row]);
  return static_cast<double>(kernel_[row * static_cast<std::size_t>(2 * radius_ + 1) + column]);
}

void SpreadKernel::apply(const std::vector<float>& in, int width, int height, std::vector<float>& out,
                         const StopToken& stop) const {
  const auto w = static_cast<std::size_t>(width), h = static_cast<std::size_t>(height),
             r = static_cast<std::size_t>(radius_);
  const std::size_t side = 2 * r + 1, padded_width = w + 2 * r;
  out.assign(w * h, 0.F);
  if (row_.empty()) {
    in_parallel_pieces(h, kRows, [&](std::size_t first, std::size_t past_last) {
      for (std::size_t y = first; y < past_last; ++y) {
        stop.check();
        for (std::size_t j = 0; j < side; ++j)
          for (std::size_t i = 0; i < side; ++i)  // light that moves by (dx, dy) comes from (-dx, -dy)
            add_weighted(&in[(y + j) * padded_width + i], kernel_[(side - 1 - j) * side + side - 1 - i], w,
                         &out[y * w]);
      }
    });
    return;
  }
  std::vector<float> across(w * (h + 2 * r), 0.F);
  in_parallel_pieces(h + 2 * r, kRows, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t y = first; y < past_last; ++y) {
      stop.check();
      for (std::size_t i = 0; i < side; ++i)
        add_weighted(&in[y * padded_width + i], row_[side - 1 - i], w, &across[y * w]);
    }
  });
  in_parallel_pieces(h, kRows, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t y = first; y < past_last; ++y) {
      stop.check();
      for (std::size_t j = 0; j < side; ++j) add_weighted(&across[(y + j) * w], column_[side - 1 - j], w, &out[y * w]);
    }
  });
}

double transmission(const Vignetting& vignetting, const Vec3& in_camera) {
  switch (vignetting.model) {
    case Vignetting::Model::none:
      break;
    case Vignetting::Model::cos4: {
      const double cosine = std::max(in_camera.z(), 0.0);
      return cosine * cosine * cosine * cosine;
    }
    case Vignetting::Model::table: {
      const double angle_deg = std::atan2(std::hypot(in_camera.x(), in_camera.y()), in_camera.z()) * kDegreesPerRadian;
      return interpolated(vignetting.table, angle_deg, &Vignetting::Point::angle_deg, &Vignetting::Point::transmission);
    }
  }
  return 1;
}

void vignette(const Vignetting& vignetting, const Camera& c, const PixelRays& rays, std::vector<float>& radiance,
              const StopToken& stop) {
  if (vignetting.model == Vignetting::Model::none) return;
  const auto width = static_cast<std::size_t>(c.width), lines = static_cast<std::size_t>(c.height);
  const bool bends = !rays.x.empty();
  const auto of_angle = [&](double radians) {
    const double angle_deg = radians * kDegreesPerRadian;
    return interpolated(vignetting.table, angle_deg, &Vignetting::Point::angle_deg, &Vignetting::Point::transmission);
  };
  const bool cos4 = vignetting.model == Vignetting::Model::cos4;
  // Transmission by the squared tangent of the angle: the squared distance on the plane z = 1.
  const auto of_tangent2 = [&](double tan2) {
    return cos4 ? 1 / ((1 + tan2) * (1 + tan2)) : of_angle(std::atan(std::sqrt(tan2)));
  };
  in_parallel_pieces(radiance.size() / width, kRows, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t y = first; y < past_last; ++y) {
      stop.check();
      const std::size_t line = std::min(y, lines - 1);
      for (std::size_t x = 0; x < width; ++x) {
        const std::size_t at = line * width + x;
        const double px = bends ? rays.x[at] : (static_cast<double>(x) - c.cx) / c.fx,
                     py = bends ? rays.y[at] : (static_cast<double>(line) - c.cy) / c.fy;
        if (std::isnan(px)) continue;
        radiance[y * width + x] *= static_cast<float>(rays.z.empty() ? of_tangent2(px * px + py * py)
                                                                     : transmission(vignetting, {px, py, rays.z[at]}));
      }
    }
  });
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
