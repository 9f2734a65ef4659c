// Level of detail of the terrain, and samples per pixel.
#pragma once

#include <algorithm>

namespace selenograph::engine {

struct Accuracy {
  // Upper bound of the projected vertical error of the mesh, pixels. The post spacing stays below twice this many
  // pixels. 0: the finest posts everywhere.
  double max_error_px = 0.5;
  int samples_per_pixel = 1;  // a square number: radiance and image are means over a regular grid in the pixel
  // Target for the shift of a shadow edge on level ground by the mesh's error, pixels: vertical error over the tangent
  // of the Sun's elevation. It is relaxed if that much terrain does not fit into memory; the frame reports the value
  // that was used.
  double max_shadow_error_px = kDefaultShadowError_px;
  static constexpr double kDefaultShadowError_px = 16;
  // Target for detail that is left out, or max_error_px if that is larger. Diameters and wavelengths from
  // kSmallestShown times as many pixels on are shown, foreshortened as the mean over all directions. Smaller detail
  // moves few points by so many pixels and hardly changes the contrast. If a frame had more triangles of detail than
  // max_detail_triangles(), the shadow target is relaxed; if that does not suffice, or the view alone has four fifths
  // as many, this one is.
  double max_detail_error_px = kDefaultDetailError_px;
  static constexpr double kDefaultDetailError_px = 4;
  static constexpr double kSmallestShown = 1.25;
  static constexpr double kDetailTrianglesPerPixel = 8;
  // Each octave of distance needs its ring of blocks, however few pixels it covers: a view from 1.6 m to the horizon
  // has 11 of them.
  static constexpr double kMinDetailTriangles = 12e6;
  bool operator==(const Accuracy&) const = default;
  static double max_detail_triangles(double pixels) {
    return std::max(kDetailTrianglesPerPixel * pixels, kMinDetailTriangles);
  }
  double detail_aim_px() const { return std::max(max_error_px, max_detail_error_px); }
};

}  // namespace selenograph::engine
