// Measures the error and the cost of light from terrain, compared with rays in every direction or a closed form.
#pragma once

#include <functional>
#include <vector>

#include "engine/frame/map.h"
#include "engine/renderer.h"

namespace selenograph::engine {

// The true light that points of a frame receive from surrounding ground. Reflectance is the request's, without maps.
class IndirectTruth {
 public:
  static constexpr int kAzimuths = 1440;
  // A point's rays: each azimuth has one in every stratum of low elevations and one high up. Low elevations need more
  // strata under a low Sun: the ground that it lights is seen as thin strips.
  struct Rays {
    int strata;
    int azimuths = kAzimuths;
  };
  // Casts rays from a lattice of points of a square frame, 144 or more.
  IndirectTruth(const Renderer& renderer, const FrameRequest& request, const Rays& rays);
  // Takes the light of those points, W m-2, from their positions; NaN leaves a point out.
  IndirectTruth(const Renderer& renderer, const FrameRequest& request,
                const std::function<double(const Vec3& position_m)>& light_w_m2);

  struct Error {
    int places = 0;
    int shadows = 0;            // of the places
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
  IndirectTruth(const Renderer& renderer, const FrameRequest& request);

  FrameRequest request_;
  std::vector<Vec3> positions_m_, normals_;
  std::vector<std::size_t> pixels_;  // by index into positions_m_, as all below
  std::vector<double> light_w_m2_;
  std::vector<bool> in_shadow_;
};

// Processor times of all threads: of a frame or map without light from terrain, of the first one with it, of the first
// one under another Sun, and of one that finds the light cached (kept_ms).
struct IndirectTimes {
  double without_ms = 0, first_ms = 0, new_sun_ms = 0, kept_ms = 0;
};

// Error and times of a frame with light from terrain.
struct IndirectRow {
  double spacing_px = 0;
  IndirectTruth::Error error;
  IndirectTimes times;
};
// Measures one spacing of posts. `renderer` must not have rendered such a frame before: its light would be cached. The
// process should do nothing else meanwhile.
IndirectRow measure_indirect(const Renderer& renderer, const IndirectTruth& truth, double spacing_px, int repetitions);

// Times of a map with light from terrain, and what its posts of light hold: their light, their views of the ground, and
// their part of the relief.
struct IndirectMapRow {
  IndirectTimes times;
  std::size_t posts = 0;
  double bytes_per_post = 0;
};
// Measures a map. As for measure_indirect(), `renderer` must not have rendered any light from terrain before.
IndirectMapRow measure_indirect_map(const Renderer& renderer, const MapRequest& request, int repetitions);

// Returns a map of 200 x 200 pixels of 10 m around a place, of the ground's irradiance. The caller adds Sun and ground.
MapRequest indirect_site(const Geographic& center);

}  // namespace selenograph::engine
