// The yardstick: what Embree alone needs for the primary and shadow rays of a frame, nothing else.
//
// Float throughout, a constant bias instead of exact shadows, geometric normals, no refinement, no products but one
// float per pixel.
#pragma once

#include <embree3/rtcore.h>

#include <vector>

#include "engine/mesh.h"
#include "engine/view.h"

namespace selenograph::bench {

class BareKernel {
 public:
  BareKernel(const engine::Mesh& mesh, const Vec3& anchor_m, int threads);
  ~BareKernel();
  BareKernel(const BareKernel&) = delete;
  BareKernel& operator=(const BareKernel&) = delete;

  // One frame of the (undistorted) view from inside or outside of the terrain's shell; `image` gets mu0 / (mu0 + mu) or
  // 0.
  void render(const engine::View& view, const Vec3& sun, double shell_radius_m, std::vector<float>& image) const;

 private:
  RTCDevice device_;
  RTCScene scene_;
  Vec3 anchor_;
};

}  // namespace selenograph::bench
