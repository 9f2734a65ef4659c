// Speed against error: every setting on every scene, measured against the finest terrain with many samples per pixel.
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
  std::vector<int> samples_with_edges = {4};  // of the former, once more with samples at edges
  std::vector<Visibility> methods = {Visibility::raytrace, Visibility::zbuffer};
  std::vector<double> max_shadow_errors_px = {64, 4, 1};  // besides the default: with the default of everything else
  std::vector<double> max_detail_errors_px = {1, 0.5};    // the same, of scenes with detail
  int reference_samples = 256;
  int repetitions = 7;  // of each time measurement; the median counts
};

// One setting on one scene. Times are sums over the scene's frames, of a warm radiance frame: what a navigation loop
// asks for again and again. A setting whose terrain doesn't fit in one of the frames has no row.
struct SweepRow {
  std::string scene;
  Accuracy setting;
  Visibility visibility = Visibility::raytrace;
  double frame_ms = 0;
  double bare_ms = 0;           // the bare kernel on the finest mesh, one sample per pixel, alternating with the frames
  std::size_t triangles = 0;    // the most of one frame
  std::size_t scene_bytes = 0;  // mesh and acceleration structure, the most of one frame
  double bound_px = 0, bound_m = 0;  // the largest that was reported
  double shadow_bound_px = 0;        // the same of shadow_error_px
  ErrorMeasures errors;
  // What the reference was made with: 0, the finest posts everywhere, or the smallest bound (a power of two) of which
  // the terrain in view fits. Of a scene with detail that of the detail, which has no finest posts.
  double reference_max_error_px = 0;
  bool with_detail = false;
  double ratio() const { return frame_ms / bare_ms; }
};

// progress(done, total, what is next) from the calling thread. Throws what Renderer::render throws.
using SweepProgress = std::function<void(std::size_t done, std::size_t total, const std::string& next)>;
std::vector<SweepRow> sweep(const Renderer& renderer, const std::vector<AccuracyScene>& scenes,
                            const SweepOptions& options, const SweepProgress& progress, const StopToken& stop = {});

}  // namespace selenograph::engine
