// What visibility works on: a joined mesh and its acceleration structure, shared between frames that see the same
// terrain.
#pragma once

#include <algorithm>
#include <memory>

#include "engine/mesh.h"
#include "engine/ray_tracer.h"
#include "engine/selection.h"

namespace selenograph::engine {

struct Scene {
  Scene(const dem::Terrain& terrain, const Selection& selection, const Vec3& anchor_m, int threads)
      : mesh(terrain, selection.blocks),
        tracer(mesh, anchor_m, threads),
        shell_m(kMoonRadius_m + highest_m(mesh) + 1) {}

  // From the blocks alone, not from how they were selected: scenes of the same blocks are the same scene.
  static double highest_m(const Mesh& mesh) {
    float highest = dem::kLowestRelief_m;
    for (const MeshBlock& b : mesh.blocks()) highest = std::max(highest, b.posts->max_m);
    return static_cast<double>(highest);
  }

  std::size_t bytes() const { return mesh.bytes() + tracer.bytes(); }

  Mesh mesh;
  RayTracer tracer;
  double shell_m;  // radius of a sphere around everything in it
};

// Near the camera, or, far away, near the surface in the view's middle; snapped to a lattice of 4096 m so that
// consecutive frames share it.
Vec3 anchor_for(const Vec3& camera_m, const Vec3& middle);

}  // namespace selenograph::engine
