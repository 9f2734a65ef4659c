// Regions of an image, and the subset of pixels for ground-truth products: all products except image and radiance.
#pragma once

#include <cstddef>
#include <optional>

namespace selenograph::engine {

// A rectangle of pixels. Width 0: the whole image.
struct ImageRegion {
  int x = 0, y = 0, width = 0, height = 0;
};

// Every n-th pixel of a region, from its first. The arrays have rows() x columns() elements; element (r, c) belongs to
// the image's pixel in row y + r * every_px and column x + c * every_px.
struct TruthGrid : ImageRegion {
  enum class Floats { float64, float32, float16 };

  int every_px = 1;
  // MOON_ME, m: positions are stored relative to it, as float. Empty: absolute, as double.
  std::optional<Vec3> position_origin_m{};
  Floats distances = Floats::float64;  // format of depth and range

  int columns() const { return (width + every_px - 1) / every_px; }
  int rows() const { return (height + every_px - 1) / every_px; }
  std::size_t size() const { return static_cast<std::size_t>(columns()) * static_cast<std::size_t>(rows()); }

  bool has_row(int pixel_y) const { return has(pixel_y - y, height); }
  // Returns the index of a pixel in the arrays; empty: not in the subset.
  std::optional<std::size_t> slot(int pixel_x, int pixel_y) const {
    if (!has_row(pixel_y) || !has(pixel_x - x, width)) return std::nullopt;
    return static_cast<std::size_t>((pixel_y - y) / every_px) * static_cast<std::size_t>(columns()) +
           static_cast<std::size_t>((pixel_x - x) / every_px);
  }

 private:
  bool has(int from_first, int size_px) const {
    return from_first >= 0 && from_first < size_px && from_first % every_px == 0;
  }
};

}  // namespace selenograph::engine
