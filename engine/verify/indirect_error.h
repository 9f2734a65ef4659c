// How true light from terrain is, and how long it takes: beside rays in every direction.
#pragma once

#include <vector>

#include "engine/frame/queries.h"
#include "engine/renderer.h"

namespace selenograph::engine {

// Light that points of a frame receive from surrounding ground, by rays. Reflectance is the request's, without maps.
class IndirectTruth {
 public:
  // 144 places of a square frame. From each, 128 azimuths times `strata` and eight more elevations: what a low Sun
  // lights is thin strips. With 80 the answer is off by a tenth there.
  IndirectTruth(const Renderer& renderer, const FrameRequest& request, int strata);

  struct Error {
    int places = 0;
    double ratio = 0, rms = 0;  // of the means; of the differences, over the mean
    double median = 0;          // of the differences over the place's own light
    double worst = 0;           // the same, where it exceeds 1e-4 of sunlight
    double shadow_ratio = 1;    // of the means over places in shadow
  };
  // `irradiance`: the product of a frame of request(), with any spacing of posts.
  Error of(const std::vector<float>& irradiance) const;
  const FrameRequest& request() const { return request_; }

 private:
  FrameRequest request_;
  std::vector<std::size_t> pixels_;
  std::vector<double> light_w_m2_;  // of each pixel
  std::vector<bool> in_shadow_;     // of each pixel
};

// Times of a frame without light from terrain, the first with it, and one that finds it again.
struct IndirectRow {
  double spacing_px = 0;
  IndirectTruth::Error error;
  double without_ms = 0, first_ms = 0, kept_ms = 0;
};
// `renderer` must not have shown such a frame before.
IndirectRow measure_indirect(const Renderer& renderer, const IndirectTruth& truth, double spacing_px, int repetitions);

}  // namespace selenograph::engine
