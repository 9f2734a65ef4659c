// A joined mesh with its acceleration structure, shared between frames that see the same terrain.
#pragma once

#include <algorithm>
#include <memory>
#include <vector>

#include "engine/frame/request.h"
#include "engine/scene/mesh.h"
#include "engine/scene/raster_mesh.h"
#include "engine/visibility/embree/ray_tracer.h"

namespace selenograph::engine {

// All that a scene depends on: the key of the scene cache.
struct SceneContent {
  std::vector<dem::BlockId> blocks;  // as selected, sorted
  Vec3 anchor_m = Vec3::zero();      // origin of its float coordinates
  Visibility visibility = Visibility::raytrace;
  const dem::Terrain* terrain = nullptr;  // the terrain with its detail; null: without detail
  std::vector<Corners> soft_corners{};    // as selected; empty: normals stay as they are
};

// Parts of a scene that another scene may reuse.
struct SceneParts {
  std::shared_ptr<const Mesh> mesh;  // may be null
  RasterParts raster;
};

struct Scene {
  // Builds the structure of one visibility algorithm only. `before`: parts of a scene with the same anchor that may
  // have blocks in common. Throws Cancelled when stopped.
  Scene(const dem::Terrain& terrain, const SceneContent& content, int threads, const SceneParts& before = {},
        const StopToken& stop = {})
      : shared_mesh(std::make_shared<Mesh>(terrain, content.blocks, before.mesh.get(), stop, content.soft_corners)),
        shell_m(kMoonRadius_m + highest_m(mesh) + 1),
        core_m(core_of(mesh)),
        anchor(content.anchor_m),
        detail(terrain.detail_number()) {
    stop.check();
    if (content.visibility == Visibility::zbuffer)
      raster = std::make_unique<RasterMesh>(mesh, anchor, before.raster, stop);
    else
      tracer = std::make_unique<RayTracer>(mesh, anchor, threads, stop);
    bytes = mesh.bytes() + (tracer ? tracer->bytes() : 0) + (raster ? raster->bytes() : 0);
    for (const MeshBlock& b : mesh.blocks())  // blocks without data are not in the mesh
      triangles += static_cast<std::size_t>(dem::triangles_of_block(b.posts->id.level));
  }

  // Returns the parts that a scene with another anchor can reuse: keeping them holds less memory than keeping this
  // scene.
  SceneParts parts_for(const Vec3& anchor_m) const {
    return {shared_mesh, raster ? raster->parts_for(anchor_m) : RasterParts{}};
  }

  // Returns the largest height. It depends on the blocks only, not on their selection: scenes of the same blocks are
  // identical.
  static double highest_m(const Mesh& mesh) {
    float highest = dem::kLowestRelief_m;
    for (const MeshBlock& b : mesh.blocks()) highest = std::max(highest, b.posts->max_m);
    return static_cast<double>(highest);
  }

  // Returns the radius of a sphere below the scene. Ground without data counts as at height 0 or as high as the lowest
  // post of the mesh, whichever is lower: a ray that passes above this sphere sees the sky.
  static double core_of(const Mesh& mesh) {
    float lowest = 0;
    int coarsest = dem::kMaxLevel;
    for (const MeshBlock& b : mesh.blocks()) {
      lowest = std::min(lowest, b.posts->min_m);
      coarsest = std::min(coarsest, b.posts->id.level);
    }
    return kMoonRadius_m + static_cast<double>(lowest) - dem::chord_sag_m(coarsest);
  }

  // Calls visit(address, bytes) for the parts that may be shared with other scenes. own_bytes() are the bytes of the
  // rest.
  template <typename Visit>
  void for_each_part(const Visit& visit) const {
    for (const MeshBlock& block : mesh.blocks()) visit(static_cast<const void*>(&block), block.bytes());
    if (!raster) return;
    for (const auto& piece : raster->pieces()) {
      visit(static_cast<const void*>(piece.get()), piece->bytes());
      visit(static_cast<const void*>(piece->shape.get()), piece->shape->bytes());
    }
  }
  std::size_t own_bytes() const {
    return sizeof(Scene) + mesh.blocks().size() * 64 + (tracer ? tracer->bytes() : 0) +
           (raster ? raster->own_bytes() : 0);
  }

  const std::shared_ptr<const Mesh> shared_mesh;
  const Mesh& mesh = *shared_mesh;
  std::unique_ptr<RayTracer> tracer;
  std::unique_ptr<RasterMesh> raster;
  double shell_m;  // radius of a sphere around the scene
  double core_m;   // radius of a sphere below the scene and the datum
  Vec3 anchor;     // origin of both structures' float coordinates
  int detail;      // dem::Terrain::detail_number()
  // Bytes of all parts. They are summed once: visiting every block takes milliseconds.
  std::size_t bytes = 0, triangles = 0;
};

}  // namespace selenograph::engine
