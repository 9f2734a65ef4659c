// Triangle meshes in the scene other than the terrain.
#pragma once

#include <memory>
#include <vector>

#include "dem/grid/geodesy.h"
#include "dem/grid/rotation.h"
#include "engine/frame/surface.h"

namespace selenograph::engine {

class ObjectMesh;

// An object in the scene. Both sides of its triangles are surface; it casts and receives shadows.
struct SceneObject {
  std::shared_ptr<const ObjectMesh> mesh;
  Vec3 position_m = Vec3::zero();            // position of the mesh's origin, MOON_ME
  Quat moon_from_object = Quat::identity();  // unit; the mesh's axes are its file's
  double scale = 1;                          // metres per unit of the file
  std::vector<Material> materials;           // one material for each part of the mesh
};

}  // namespace selenograph::engine
