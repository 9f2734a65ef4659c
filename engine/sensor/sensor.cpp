#include "engine/sensor/sensor.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <iterator>
#include <numbers>
#include <numeric>

#include "dem/base/parallel.h"
#include "dem/base/quantile.h"
#include "engine/radiometry/moon.h"
#include "engine/radiometry/spectrum.h"

namespace selenograph::engine {

namespace {

// Returns the combined results of work(pixels of a piece, index of the first) over all pieces of an image. Pieces run
// in parallel; results are combined in order, so that they do not depend on the threads.
template <typename T, typename Work, typename Combine>
T over_pieces(std::span<const float> pixels, const Work& work, const Combine& combine) {
  constexpr std::size_t kPiece_px = 1 << 16;
  std::vector<T> results((pixels.size() + kPiece_px - 1) / kPiece_px);
  in_parallel(results.size(), [&](std::size_t i) {
    const std::size_t first = i * kPiece_px;
    results[i] = work(pixels.subspan(first, std::min(kPiece_px, pixels.size() - first)), first);
  });
  return std::accumulate(results.begin() + 1, results.end(), results.front(), combine);
}

// Returns the largest of values and `largest_so_far`; NaN among the values is not.
float largest_of(std::span<const float> values, float largest_so_far) {
  constexpr std::size_t kLanes = 16;  // independent maxima, which the compiler keeps in vectors
  float largest[kLanes];
  std::fill_n(largest, kLanes, largest_so_far);
  std::size_t i = 0;
  for (; i + kLanes <= values.size(); i += kLanes)
    for (std::size_t k = 0; k < kLanes; ++k) largest[k] = values[i + k] > largest[k] ? values[i + k] : largest[k];
  for (; i < values.size(); ++i) largest[0] = std::max(largest[0], values[i]);
  return *std::max_element(largest, largest + kLanes);
}

}  // namespace

bool any_lit(std::span<const float> radiance) {
  return std::ranges::any_of(radiance, [](float value) { return value > 0; });
}

std::size_t brightest_pixel(std::span<const float> radiance) {
  return over_pieces<std::size_t>(
      radiance,
      [](std::span<const float> piece, std::size_t first) {
        return first +
               static_cast<std::size_t>(std::ranges::find(piece, largest_of(piece, piece.front())) - piece.begin());
      },
      [&](std::size_t a, std::size_t b) { return radiance[b] > radiance[a] ? b : a; });
}

double almost_brightest(std::span<const float> radiance) {
  // If n pieces have a maximum of at least a value, so have n pixels: a rank among the maxima bounds the same rank
  // among the pixels from below.
  constexpr std::size_t kPiece_px = 256;
  const std::size_t pieces = (radiance.size() + kPiece_px - 1) / kPiece_px;
  const auto piece = [&](std::size_t i) {
    return radiance.subspan(i * kPiece_px, std::min(kPiece_px, radiance.size() - i * kPiece_px));
  };
  std::vector<float> maxima(pieces);
  std::vector<std::ptrdiff_t> lit(pieces);
  in_parallel_pieces(pieces, 64, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t i = first; i < past_last; ++i) {
      maxima[i] = largest_of(piece(i), 0);
      lit[i] = std::ranges::count_if(piece(i), [](float value) { return value > 0; });
    }
  });
  const auto lit_pixels = static_cast<std::size_t>(std::accumulate(lit.begin(), lit.end(), std::ptrdiff_t{0}));
  if (lit_pixels == 0) return 0;
  const std::size_t brighter = lit_pixels / 1000;
  std::vector<float> bounds = maxima, candidates;
  const float bound = ranked(bounds, pieces - 1 - brighter);
  for (std::size_t i = 0; i < pieces; ++i)
    if (maxima[i] >= bound)
      std::ranges::copy_if(piece(i), std::back_inserter(candidates), [bound](float value) { return value >= bound; });
  return static_cast<double>(ranked(candidates, candidates.size() - 1 - brighter));
}

double expose(const ImageSettings& settings, const std::vector<float>& radiance, std::vector<std::uint16_t>& image) {
  image.assign(radiance.size(), 0);
  const double full_scale =
      settings.full_scale_radiance_w_m2_sr ? *settings.full_scale_radiance_w_m2_sr : almost_brightest(radiance);
  if (!(full_scale > 0)) return full_scale;
  const double top = settings.bit_depth == 16 ? 65535 : 255, scale = top / full_scale;
  // Adding 1.5 * 2^52 rounds to the nearest integer, ties to even: the sum's unit in the last place is 1.
  constexpr double kRounding = 0x1.8p52;
  in_parallel_pieces(radiance.size(), std::size_t{1} << 16, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t i = first; i < past_last; ++i) {
      const double dn = static_cast<double>(radiance[i]) * scale, above = dn > 0 ? dn : 0;
      image[i] =
          static_cast<std::uint16_t>(static_cast<std::int32_t>((above < top ? above : top) + kRounding - kRounding));
    }
  });
  return full_scale;
}

double share_above(const std::vector<float>& radiance, double limit) {
  if (radiance.empty()) return 0;
  const auto above = over_pieces<std::ptrdiff_t>(
      radiance,
      [limit](std::span<const float> piece, std::size_t) {
        return std::ranges::count_if(piece, [limit](float value) { return static_cast<double>(value) > limit; });
      },
      std::plus<>());
  return static_cast<double>(above) / static_cast<double>(radiance.size());
}

void add_square(std::vector<float>& image, int width, int height, double x_px, double y_px, double value,
                std::optional<int> only_row) {
  const double left = std::floor(x_px), top = std::floor(y_px), right = x_px - left, below = y_px - top;
  for (const int down : {0, 1})
    for (const int across : {0, 1}) {
      const double x = left + across, y = top + down;
      if (!(x >= 0 && y >= 0 && x < width && y < height) || (only_row && y != *only_row)) continue;
      const auto at = static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
      image[at] += static_cast<float>(value * (across ? right : 1 - right) * (down ? below : 1 - below));
    }
}

namespace {

void add_to(std::vector<float>& sum, const std::vector<float>& terms) {
  for (std::size_t i = 0; i < terms.size(); ++i) sum[i] += terms[i];
}

// Returns the light in a band by which photons are counted: that of the ground with the Moon's spectrum, or sunlight.
double light_w_m2(const FrameRequest& request, const Band& band) {
  return counts_moonlight(request) ? moonlight_w_m2(request.reflectance.ground, band) : solar_irradiance_w_m2(band);
}

}  // namespace

bool counts_moonlight(const FrameRequest& request) {
  return request.terrain && request.reflectance.model == ReflectanceModel::moon;
}

Sensor::Sensor(const FrameRequest& request, const StopToken& stop)
    : request_(request),
      model_(*request.sensor),
      sunlight_um_(photon_wavelength_um(*request.band, model_.detector.efficiency,
                                        [&](const Band& band) { return light_w_m2(request, band); })),
      wavelength_um_(sunlight_um_),
      kernel_(model_.optics.point_spread, model_.optics.f_number, model_.detector.pixel_pitch_um,
              request.band->center_um(), stop) {}

std::optional<Band> Sensor::photon_band(bool one_spectrum) {
  if (one_spectrum) return std::nullopt;
  wavelength_um_ = request_.band->center_um();
  return in_photons(*request_.band, model_.detector.efficiency);
}

double Sensor::full_scale_counted_w_m2_sr() const {
  const Detector& d = model_.detector;
  return ((1 << d.bit_depth) - 1 - d.offset_dn) * d.gain_e_dn /
         electrons_per_radiance(model_.optics, d, wavelength_um_);
}

void Sensor::pass_optics(const Camera& camera, const PixelRays& rays, std::vector<float>& radiance,
                         const StopToken& stop) const {
  vignette(model_.optics.vignetting, camera, rays, radiance, stop);
  if (model_.optics.point_spread.model == PointSpread::Model::none) return;
  std::vector<float> spread;
  kernel_.apply(radiance, request_.camera.width, request_.camera.height, spread, stop);
  radiance.swap(spread);
}

void Sensor::complete(std::vector<float>& radiance, const StopToken& stop) {
  add_to(radiance, points_);
  if (!scattered_) return;
  scattered_->apply(radiance, stop);
  add_to(radiance, glare_);
}

void Sensor::add_glare(const Vec3& toward_sun, double counted_w_m2, const StopToken& stop) {
  glare_.assign(static_cast<std::size_t>(request_.camera.width) * static_cast<std::size_t>(request_.camera.height),
                0.F);
  largest_glare_w_m2_sr_ = engine::add_glare(model_.optics.stray_light, request_.camera, toward_sun,
                                             counted_w_m2 * request_.band->center_um() / wavelength_um_, glare_, stop) /
                           counted_of_sunlight();
}

bool Sensor::wants_samples() const {
  return request_.accuracy.samples_per_pixel > 1 && model_.optics.point_spread.model != PointSpread::Model::none;
}

const SpreadKernel& Sensor::shifted(double dx, double dy, const StopToken& stop) {
  const auto cached = shifted_.find({dx, dy});
  if (cached != shifted_.end()) return cached->second;
  return shifted_.emplace(std::pair(dx, dy), kernel_.shifted(model_.optics.point_spread, dx, dy, stop)).first->second;
}

void Sensor::add_sample(const Camera& camera, const PixelRays& rays, const SubpixelSample& sample, float share,
                        std::vector<float> radiance, const StopToken& stop) {
  const SpreadKernel& kernel = shifted(sample.dx, sample.dy, stop);
  vignette(model_.optics.vignetting, camera, rays, radiance, stop);
  std::vector<float> spread;
  kernel.apply(radiance, request_.camera.width, request_.camera.height, spread, stop);
  samples_.resize(spread.size(), 0.F);
  const float weight = share * sample.weight;
  for (std::size_t i = 0; i < spread.size(); ++i) samples_[i] += weight * spread[i];
}

void Sensor::choose_integration_time(const Camera& camera, const PixelRays& rays, std::vector<float> radiance,
                                     const StopToken& stop) {
  const Exposure& exposure = model_.exposure;
  if (!(exposure.target_fill > 0) || radiance.empty()) return;
  pass_optics(camera, rays, radiance, stop);
  complete(radiance, stop);
  Detector& d = model_.detector;
  const double fill_s = time_to_fill_s(model_, wavelength_um_, filled_e(d, exposure.target_fill), radiance,
                                       request_.camera.width, request_.camera.height);
  d.integration_time_s = std::clamp(fill_s, exposure.shortest_s, exposure.longest_s);
}

void Sensor::image(const Camera& camera, const PixelRays& rays, std::vector<float> radiance,
                   std::vector<std::uint16_t>& image, const StopToken& stop) {
  if (samples_.empty()) {
    pass_optics(camera, rays, radiance, stop);
  } else {
    radiance = std::move(samples_);
    samples_.clear();
  }
  complete(radiance, stop);
  read_out_ = detect(model_, wavelength_um_, radiance, request_.camera.width, request_.camera.height, image, stop,
                     request_.shutter && request_.shutter->pushbroom);
}

double Sensor::point_e(const LightPoint& point) const {
  return point.counted_w_m2_sr * transmission(model_.optics.vignetting, point.in_camera) *
         electrons_per_radiance(model_.optics, model_.detector, request_.band->center_um());
}

void Sensor::add_kernel(const SpreadKernel& kernel, int column, int row, double value, std::optional<int> only_row) {
  const int r = kernel.radius(), width = request_.camera.width, height = request_.camera.height;
  const int first = std::max({0, row - r, only_row.value_or(0)}),
            last = std::min({height - 1, row + r, only_row.value_or(height)});
  for (int y = first; y <= last; ++y)
    for (int x = std::max(0, column - r); x <= std::min(width - 1, column + r); ++x)
      points_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)] +=
          static_cast<float>(value * kernel.weight(x - column, y - row));
}

void Sensor::add_points(std::span<const LightPoint> points, double share, const StopToken& stop) {
  if (points.empty()) return;
  const int width = request_.camera.width, height = request_.camera.height;
  points_.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), 0.F);
  // Convert to the radiance that the image is counted in.
  const double unit = share * request_.band->center_um() / wavelength_um_;
  for (const LightPoint& point : points) {
    const double value = unit * transmission(model_.optics.vignetting, point.in_camera) * point.counted_w_m2_sr;
    if (model_.optics.point_spread.model == PointSpread::Model::none) {
      add_square(points_, width, height, point.x_px, point.y_px, value, point.row);
      continue;
    }
    // Kernels are made for sub-pixel positions in steps of 1/8 pixel. The four around the point share its light, which
    // keeps the centroid.
    constexpr int kSteps = 8;
    const int column = static_cast<int>(std::lround(point.x_px)), row = static_cast<int>(std::lround(point.y_px));
    const double across = (point.x_px - column + 0.5) * kSteps, down = (point.y_px - row + 0.5) * kSteps;
    const int i = std::clamp(static_cast<int>(across), 0, kSteps - 1),
              j = std::clamp(static_cast<int>(down), 0, kSteps - 1);
    for (const int dj : {0, 1})
      for (const int di : {0, 1}) {
        const double weight = (di ? across - i : i + 1 - across) * (dj ? down - j : j + 1 - down);
        if (weight > 0)
          add_kernel(shifted((i + di) / double{kSteps} - 0.5, (j + dj) / double{kSteps} - 0.5, stop), column, row,
                     weight * value, point.row);
      }
  }
}

Camera with_margin(Camera camera, int margin_px) {
  camera.width += 2 * margin_px;
  camera.height += 2 * margin_px;
  camera.cx += margin_px;
  camera.cy += margin_px;
  return camera;
}

namespace {

// Removes the margin from an array. An array that does not cover the margin's pixels (the image) stays as it is.
template <typename T>
void crop_array(std::vector<T>& array, const Camera& camera, int margin_px) {
  const std::size_t channels =
      array.size() / (static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height));
  if (channels == 0) return;
  const auto margin = static_cast<std::size_t>(margin_px), stride = channels * static_cast<std::size_t>(camera.width);
  const std::size_t row = stride - 2 * margin * channels, rows = static_cast<std::size_t>(camera.height) - 2 * margin;
  for (std::size_t y = 0; y < rows; ++y)
    std::copy_n(array.begin() + static_cast<std::ptrdiff_t>((y + margin) * stride + margin * channels), row,
                array.begin() + static_cast<std::ptrdiff_t>(y * row));
  array.resize(rows * row);
}

}  // namespace

void crop(FrameProducts& products, const Camera& camera, int margin_px, bool of_truth_grid) {
  if (margin_px == 0) return;
  if (of_truth_grid) return crop_array(products.radiance, camera, margin_px);
  std::apply([&](auto&... array) { (crop_array(array, camera, margin_px), ...); }, all_arrays(products));
}

}  // namespace selenograph::engine
