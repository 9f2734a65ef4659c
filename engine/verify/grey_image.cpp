#include "engine/verify/grey_image.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>

namespace selenograph::engine {
namespace {

// Returns half of a symmetric kernel, from its middle outwards, of sum 1 in total.
std::vector<double> half_gaussian(double sigma_px) {
  const int radius = static_cast<int>(std::ceil(4 * sigma_px));
  std::vector<double> half;
  for (int k = 0; k <= radius; ++k) half.push_back(std::exp(-0.5 * k * k / (sigma_px * sigma_px)));
  const double sum = 2 * std::accumulate(half.begin(), half.end(), 0.0) - half.front();
  for (double& weight : half) weight /= sum;
  return half;
}

// Returns an index mirrored into 0 .. count - 1, with the outermost pixel repeated.
int mirrored(int index, int count) {
  const int period = 2 * count, k = ((index % period) + period) % period;
  return k < count ? k : period - 1 - k;
}

// Convolves `count` values that are `stride` apart, in place.
void convolve_line(double* line, int count, std::ptrdiff_t stride, std::span<const double> half,
                   std::vector<double>& copy) {
  const int radius = static_cast<int>(half.size()) - 1;
  copy.clear();
  for (int k = -radius; k < count + radius; ++k) copy.push_back(line[mirrored(k, count) * stride]);
  for (int k = 0; k < count; ++k) {
    const double* middle = copy.data() + k + radius;
    double sum = half[0] * *middle;
    for (int r = 1; r <= radius; ++r) sum += half[static_cast<std::size_t>(r)] * (middle[-r] + middle[r]);
    line[k * stride] = sum;
  }
}

// A step of a non-decreasing curve: a mean over some bins.
struct IsotonicPool {
  double mean, weight;
  int bins;
};

// Returns the non-decreasing sequence that is nearest to the means in weighted least squares.
std::vector<double> isotonic(std::span<const double> means, std::span<const double> weights) {
  std::vector<IsotonicPool> pools;
  for (std::size_t k = 0; k < means.size(); ++k) {
    pools.push_back({means[k], weights[k], 1});
    while (pools.size() > 1 && pools[pools.size() - 2].mean > pools.back().mean) {
      const IsotonicPool last = pools.back();
      pools.pop_back();
      IsotonicPool& pool = pools.back();
      pool.mean = (pool.mean * pool.weight + last.mean * last.weight) / (pool.weight + last.weight);
      pool.weight += last.weight;
      pool.bins += last.bins;
    }
  }
  std::vector<double> out;
  for (const IsotonicPool& pool : pools) out.insert(out.end(), static_cast<std::size_t>(pool.bins), pool.mean);
  return out;
}

}  // namespace

GreyImage blurred(const GreyImage& image, double sigma_px) {
  GreyImage out = image;
  const std::vector<double> half = half_gaussian(sigma_px);
  std::vector<double> copy;
  for (int y = 0; y < out.height; ++y) convolve_line(&out.values[out.index(0, y)], out.width, 1, half, copy);
  for (int x = 0; x < out.width; ++x) convolve_line(&out.values[out.index(x, 0)], out.height, out.width, half, copy);
  return out;
}

GreyImage locally_normalised(const GreyImage& image, const PixelMask& mask, double sigma_px) {
  constexpr double kMinVariance = 1e-12, kMinWeight = 1e-9;
  GreyImage weight = image, mean = image, variance = image;
  for (std::size_t i = 0; i < mask.size(); ++i) {
    weight.values[i] = mask[i] ? 1 : 0;
    mean.values[i] = mask[i] ? image.values[i] : 0;
  }
  weight = blurred(weight, sigma_px);
  mean = blurred(mean, sigma_px);
  for (std::size_t i = 0; i < mask.size(); ++i) {
    mean.values[i] /= weight.values[i] + kMinWeight;
    variance.values[i] = mask[i] ? std::pow(image.values[i] - mean.values[i], 2) : 0;
  }
  variance = blurred(variance, sigma_px);
  GreyImage out = image;
  for (std::size_t i = 0; i < mask.size(); ++i) {
    const double deviation = std::sqrt(variance.values[i] / (weight.values[i] + kMinWeight) + kMinVariance);
    out.values[i] = mask[i] ? (image.values[i] - mean.values[i]) / deviation : 0;
  }
  return out;
}

double correlation(const GreyImage& a, const GreyImage& b, const PixelMask& mask) {
  double number = 0, mean_a = 0, mean_b = 0;
  for (std::size_t i = 0; i < mask.size(); ++i)
    if (mask[i]) {
      number += 1;
      mean_a += a.values[i];
      mean_b += b.values[i];
    }
  mean_a /= number;
  mean_b /= number;
  double aa = 0, bb = 0, ab = 0;
  for (std::size_t i = 0; i < mask.size(); ++i)
    if (mask[i]) {
      const double da = a.values[i] - mean_a, db = b.values[i] - mean_b;
      aa += da * da;
      bb += db * db;
      ab += da * db;
    }
  return aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : std::nan("");
}

GreyImage enlarged(const GreyImage& image, int factor) {
  GreyImage out{image.width * factor, image.height * factor, {}};
  out.values.reserve(static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height));
  const auto position = [&](int k, int count) {
    return std::clamp((k + 0.5) / factor - 0.5, 0.0, static_cast<double>(count - 1));
  };
  for (int y = 0; y < out.height; ++y) {
    const double row = position(y, image.height);
    const int top = std::min(static_cast<int>(row), std::max(0, image.height - 2)),
              bottom = std::min(top + 1, image.height - 1);
    for (int x = 0; x < out.width; ++x) {
      const double column = position(x, image.width);
      const int left = std::min(static_cast<int>(column), std::max(0, image.width - 2)),
                right = std::min(left + 1, image.width - 1);
      out.values.push_back(std::lerp(std::lerp(image.at(left, top), image.at(right, top), column - left),
                                     std::lerp(image.at(left, bottom), image.at(right, bottom), column - left),
                                     row - top));
    }
  }
  return out;
}

ToneCurve::ToneCurve(const GreyImage& frame, const GreyImage& photograph, const PixelMask& mask) {
  constexpr std::size_t kBins = 60;
  std::vector<std::size_t> pixels;
  for (std::size_t i = 0; i < mask.size(); ++i)
    if (mask[i]) pixels.push_back(i);
  if (pixels.empty()) throw std::invalid_argument("a tone curve needs pixels");
  std::stable_sort(pixels.begin(), pixels.end(),
                   [&](std::size_t a, std::size_t b) { return frame.values[a] < frame.values[b]; });
  std::vector<double> means, weights;
  for (std::size_t k = 0, begin = 0; k < kBins; ++k) {
    std::size_t end = pixels.size() * (k + 1) / kBins;
    // Equal values stay in one bin: a curve has one value for each.
    while (end > begin && end < pixels.size() && frame.values[pixels[end]] == frame.values[pixels[end - 1]]) ++end;
    if (end <= begin) continue;
    double sum = 0;
    for (std::size_t i = begin; i < end; ++i) sum += photograph.values[pixels[i]];
    from_.push_back(frame.values[pixels[begin + (end - begin) / 2]]);
    means.push_back(sum / static_cast<double>(end - begin));
    weights.push_back(static_cast<double>(end - begin));
    begin = end;
  }
  to_ = isotonic(means, weights);
}

double ToneCurve::operator()(double value) const {
  const auto above = std::upper_bound(from_.begin(), from_.end(), value);
  if (above == from_.begin()) return to_.front();
  if (above == from_.end()) return to_.back();
  const auto k = static_cast<std::size_t>(above - from_.begin());
  return std::lerp(to_[k - 1], to_[k], (value - from_[k - 1]) / (from_[k] - from_[k - 1]));
}

GreyImage ToneCurve::operator()(const GreyImage& frame) const {
  GreyImage out = frame;
  for (double& value : out.values) value = (*this)(value);
  return out;
}

double median_of(std::vector<double> values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace selenograph::engine
