// The error of light from terrain, compared with rays in every direction or a closed form.
#pragma once

#include <functional>
#include <vector>

#include "engine/renderer.h"

namespace selenograph::test {

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
  IndirectTruth(const engine::Renderer& renderer, const engine::FrameRequest& request, const Rays& rays);
  // Takes the light of those points, W m-2, from their positions; NaN leaves a point out.
  IndirectTruth(const engine::Renderer& renderer, const engine::FrameRequest& request,
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
  const engine::FrameRequest& request() const { return request_; }

 private:
  IndirectTruth(const engine::Renderer& renderer, const engine::FrameRequest& request);

  engine::FrameRequest request_;
  std::vector<Vec3> positions_m_, normals_;
  std::vector<std::size_t> pixels_;  // by index into positions_m_, as all below
  std::vector<double> light_w_m2_;
  std::vector<bool> in_shadow_;
};

}  // namespace selenograph::test
