// The yardstick: what Embree alone needs for the primary and shadow rays of a frame, nothing else.
//
// Float throughout, a constant bias instead of exact shadows, geometric normals, no refinement, no products but one
// float per pixel. It shares nothing with ray_tracer.h on purpose: what is measured by it must not be part of it.
#pragma once

#include <memory>
#include <vector>

#include "engine/camera/view.h"
#include "engine/scene/mesh.h"

namespace selenograph::engine {

class BareKernel {
 public:
  BareKernel(const Mesh& mesh, const Vec3& anchor_m, int threads);
  ~BareKernel();
  BareKernel(const BareKernel&) = delete;
  BareKernel& operator=(const BareKernel&) = delete;

  // One frame of the (undistorted) view from inside or outside of the terrain's shell, in the caller's task arena;
  // `image` gets mu0 / (mu0 + mu) or 0. Pixels beyond the last whole 32 x 32 tile are left out.
  void render(const View& view, const Vec3& sun, double shell_radius_m, std::vector<float>& image) const;

 private:
  struct Native;
  std::unique_ptr<Native> native_;
  Vec3 anchor_;
};

}  // namespace selenograph::engine
