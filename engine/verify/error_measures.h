// Error measures of frames, as `verify accuracy` reports them for each setting.
//
// The reference is the finest terrain seen through many samples per pixel. Frames of one scene are pooled: quantiles
// are over all their pixels.
#pragma once

#include <vector>

#include "dem/terrain/terrain.h"
#include "engine/camera/view.h"
#include "engine/frame/frame.h"
#include "engine/frame/report.h"

namespace selenograph::engine {

// Statistics of absolute values; all zero without any value.
struct Spread {
  double median = 0, p999 = 0, worst = 0;
};

struct ErrorMeasures {
  // Each visible point against the finest surface vertically above or below it: the distance in metres, and the
  // distance between the two in the image.
  Spread geometric_m, geometric_px;
  // Share of points whose error is within the bound that their frame reported, in metres and in pixels.
  double within_bound_m = 1, within_bound_px = 1;
  // Share of points whose error in the image is within the frame's expected error: its 99th percentile.
  double within_expected_px = 1;
  // Share of pixels that see terrain in one frame and sky in the other.
  double wrong_hits = 0;
  // Radiance errors relative to the reference's mean radiance of sunlit pixels.
  double radiance_rms = 0, radiance_p999 = 0;
  // Share of pixels in shadow in one frame and sunlit in the other, among those that see terrain in both.
  double wrong_shadow_flags = 0;
  // Shadow edges, pixels: the mean displacement (area between the edges over the length of the reference's edges); and,
  // over the wrong pixels, the distance from the reference's edge.
  double shadow_edge_mean_px = 0;
  Spread shadow_edge_px;
};

class ErrorCollector {
 public:
  // `position_m`: the frame's product "position".
  void add_geometry(const View& view, const dem::Terrain& terrain, const std::vector<double>& position_m,
                    const FrameReport& report);
  // Both are products `lit` of height x width (NaN where nothing is hit).
  void add_shadows(int width, int height, const std::vector<float>& lit, const std::vector<float>& reference);
  void add_radiance(const std::vector<float>& radiance, const std::vector<float>& reference);

  ErrorMeasures result() const;

 private:
  std::vector<double> errors_m_, errors_px_;  // of points that have a position on the ground and in the image
  std::size_t points_beyond_bound_m_ = 0, points_beyond_bound_px_ = 0, points_beyond_expected_px_ = 0;
  std::vector<double> radiance_errors_;  // W m-2 sr-1
  double reference_radiance_ = 0;
  std::size_t sunlit_ = 0;
  std::vector<double> displacements_px_;
  // Flags are compared where both frames see terrain, hits at all pixels.
  std::size_t flags_compared_ = 0, wrong_flags_ = 0, pixels_ = 0, wrong_hits_ = 0;
  double edge_length_px_ = 0;
};

// Returns the distance from a pixel to the nearest one with the flag `lit` in the reference, minus half a pixel: the
// edge is nearer than that pixel's centre. The image's diagonal if there is none.
double distance_to_flag(int width, int height, const std::vector<float>& reference, int x, int y, bool lit);

Spread spread_of(std::vector<double> values);

}  // namespace selenograph::engine
