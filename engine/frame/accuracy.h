// How fine the terrain and how dense the samples of a frame are.
#pragma once

#include <algorithm>

namespace selenograph::engine {

struct Accuracy {
  // Bound, in pixels, on the projected vertical error of the mesh; post spacing is kept below twice this many pixels.
  // 0: the finest posts everywhere.
  double max_error_px = 0.5;
  int samples_per_pixel = 1;  // radiance and image are means over a regular sub-pixel grid; must be a square number
  // Aim, in pixels, for how far a shadow's edge on level ground is displaced by the mesh's error: vertical error over
  // the tangent of the Sun's elevation. Where not even this much more terrain fits, it gives way: the frame reports
  // what was reached.
  double max_shadow_error_px = kDefaultShadowError_px;
  static constexpr double kDefaultShadowError_px = 16;
  // Aim, in pixels, for the vertical error of a terrain with detail, or max_error_px where that is more. It gives way,
  // together with the aim for shadows, where a frame would have more than kDetailTrianglesPerPixel triangles of
  // detail for each of its pixels: the detail's bound is of the deepest crater of each size, which few places have.
  double max_detail_error_px = kDefaultDetailError_px;
  static constexpr double kDefaultDetailError_px = 2;
  static constexpr double kDetailTrianglesPerPixel = 8;
  // 4: samples at edges (visibility/edge_samples.h) give way to four each in their parts of the pixel; of 1 or 4
  // samples per pixel, without a shutter. 1: they don't.
  int edge_samples = 1;
  double detail_aim_px() const { return std::max(max_error_px, max_detail_error_px); }
};

}  // namespace selenograph::engine
