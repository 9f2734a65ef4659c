// Grey images, and the operations by which a photograph is compared with a frame of the same view.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace selenograph::engine {

// width x height values, row 0 on top; radiance or digital numbers, finite.
struct GreyImage {
  int width = 0, height = 0;
  std::vector<double> values;

  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
  }
  double at(int x, int y) const { return values[index(x, y)]; }
};

// A byte per pixel of an image: 0 excludes the pixel.
using PixelMask = std::vector<std::uint8_t>;

// Returns the image convolved with a Gaussian, which is truncated at four standard deviations. The image is mirrored at
// its borders.
GreyImage blurred(const GreyImage& image, double sigma_px);

// Returns (value - local mean) / local standard deviation, both weighted by a Gaussian over the mask's pixels; 0
// outside the mask. Two images of one scene by films of different response become comparable.
GreyImage locally_normalised(const GreyImage& image, const PixelMask& mask, double sigma_px);

// Returns Pearson's correlation over the mask's pixels; NaN if one image is constant there.
double correlation(const GreyImage& a, const GreyImage& b, const PixelMask& mask);

// Returns the image with each pixel replaced by factor x factor pixels, interpolated bilinearly between pixel centres
// and constant beyond the outermost ones.
GreyImage enlarged(const GreyImage& image, int factor);

// Monotone piecewise linear curve, for the unknown response of a film.
class ToneCurve {
 public:
  // Fits the curve that maps `frame` to `photograph` over the mask's pixels: means of the photograph over 60 bins of
  // equally many pixels of the frame, made non-decreasing by isotonic regression (pool adjacent violators). Throws
  // std::invalid_argument for an empty mask.
  ToneCurve(const GreyImage& frame, const GreyImage& photograph, const PixelMask& mask);

  double operator()(double value) const;
  GreyImage operator()(const GreyImage& frame) const;

 private:
  std::vector<double> from_, to_;  // from_ increases
};

// Returns the median of the values; NaN for none.
double median_of(std::vector<double> values);

}  // namespace selenograph::engine
