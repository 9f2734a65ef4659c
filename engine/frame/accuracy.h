// How fine the terrain and how dense the samples of a frame are.
#pragma once

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
};

}  // namespace selenograph::engine
