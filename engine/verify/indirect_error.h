// Measures the error and the cost of light from terrain, compared with rays in every direction.
#pragma once

#include <vector>

#include "engine/renderer.h"

namespace selenograph::engine {

// The true light that points of a frame receive from surrounding ground, by rays. Reflectance is the request's, without
// maps.
class IndirectTruth {
 public:
  // Casts rays from 144 points of a square frame, each in 128 azimuths times `strata` low and eight high elevations.
  // Low elevations need many strata: ground lit by a low Sun is seen as thin strips. With 80 the light is wrong by a
  // tenth there.
  IndirectTruth(const Renderer& renderer, const FrameRequest& request, int strata);

  struct Error {
    int places = 0;
    double ratio = 0, rms = 0;  // ratio of means; RMS difference over the mean
    double median = 0;          // median of relative differences
    double worst = 0;           // largest relative difference where the light exceeds 1e-4 of sunlight
    double shadow_ratio = 1;    // ratio of means over points in shadow
    double shadow_rms = 0;      // RMS difference over the mean, of points in shadow
  };
  // Returns the error of a frame. `irradiance`: the product of a frame of request(), with any spacing of posts.
  Error of(const std::vector<float>& irradiance) const;
  const FrameRequest& request() const { return request_; }

 private:
  FrameRequest request_;
  std::vector<std::size_t> pixels_;
  std::vector<double> light_w_m2_;  // by index into pixels_
  std::vector<bool> in_shadow_;     // by index into pixels_
};

// Error of a frame with light from terrain, and processor times of all threads: of a frame without it, of the first one
// with it, of the first one under another Sun, and of one that finds the light cached (kept_ms).
struct IndirectRow {
  double spacing_px = 0;
  IndirectTruth::Error error;
  double without_ms = 0, first_ms = 0, new_sun_ms = 0, kept_ms = 0;
};
// Measures one spacing of posts. `renderer` must not have rendered such a frame before: its light would be cached. The
// process should do nothing else meanwhile.
IndirectRow measure_indirect(const Renderer& renderer, const IndirectTruth& truth, double spacing_px, int repetitions);

}  // namespace selenograph::engine
