// Measures speed against error: every setting on every scene, compared with a reference of the finest terrain with many
// samples per pixel.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "engine/renderer.h"
#include "engine/verify/accuracy_scenes.h"
#include "engine/verify/error_measures.h"

namespace selenograph::engine {

struct SweepOptions {
  std::vector<double> max_errors_px = {4, 2, 1, 0.5, 0.25, 0.125, 0};
  std::vector<int> samples_per_pixel = {1, 4, 16};
  std::vector<Visibility> methods = {Visibility::raytrace, Visibility::zbuffer};
  std::vector<double> max_shadow_errors_px = {64, 4, 1};  // measured with defaults for everything else
  std::vector<double> max_detail_errors_px = {2, 1};      // the same, for scenes with detail
  int reference_samples = 256;
  int repetitions = 7;  // per time measurement; the median is reported
};

// One setting on one scene. Times are sums over the scene's frames, each a radiance frame with a cached scene, as a
// navigation loop requests them. A setting whose terrain does not fit in one of the frames has no row.
struct SweepRow {
  std::string scene;
  Accuracy setting;
  Visibility visibility = Visibility::raytrace;
  double frame_ms = 0;
  double bare_ms = 0;                // Embree baseline on the finest mesh, one sample per pixel, interleaved
  std::size_t triangles = 0;         // maximum over the frames
  std::size_t scene_bytes = 0;       // mesh and acceleration structure, maximum over the frames
  double bound_px = 0, bound_m = 0;  // largest reported bounds
  double expected_px = 0;            // largest reported expected error
  double shadow_bound_px = 0;        // largest reported shadow_error_px
  ErrorMeasures errors;
  // max_error_px of the reference: 0, the finest posts everywhere, or the smallest power of two with which the terrain
  // in view fits. For a scene with detail, which has no finest posts, max_detail_error_px as the reference reached it.
  double reference_max_error_px = 0;
  bool with_detail = false;
  double ratio() const { return frame_ms / bare_ms; }
};

// Called as progress(done, total, next) from the calling thread. The sweep throws what Renderer::render throws.
using SweepProgress = std::function<void(std::size_t done, std::size_t total, const std::string& next)>;
std::vector<SweepRow> sweep(const Renderer& renderer, const std::vector<AccuracyScene>& scenes,
                            const SweepOptions& options, const SweepProgress& progress);

}  // namespace selenograph::engine
