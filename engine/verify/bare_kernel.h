// The Embree baseline: the time of Embree alone for the primary and shadow rays of a frame.
//
// It uses float throughout, a constant bias instead of exact shadows, geometric normals, no refinement, and one float
// per pixel as output. It shares only embree.h with ray_tracer.h: the code under test must not be part of its baseline.
#pragma once

#include <vector>

#include "engine/camera/view.h"
#include "engine/scene/mesh.h"
#include "engine/visibility/embree/embree.h"

namespace selenograph::engine {

class BareKernel {
 public:
  BareKernel(const Mesh& mesh, const Vec3& anchor_m, int threads);

  // Renders one frame of the (undistorted) view, from inside or outside the terrain's shell, in the caller's task
  // arena; `image` gets mu0 / (mu0 + mu) or 0. Pixels outside complete 32 x 32 tiles are not rendered.
  void render(const View& view, const Vec3& sun, double shell_radius_m, std::vector<float>& image) const;

 private:
  EmbreeScene scene_;
  Vec3 anchor_;
};

}  // namespace selenograph::engine
