// A triangle mesh in the scene, besides the terrain.
#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <vector>

#include "dem/grid/geodesy.h"
#include "engine/frame/surface.h"

namespace selenograph::engine {

class ObjectMesh;

// A triangle mesh that isn't terrain. Both of its sides are surface. It casts shadows and receives them.
struct SceneObject {
  std::shared_ptr<const ObjectMesh> mesh;
  Vec3 position_m = Vec3::Zero();                                        // of the mesh's origin
  Eigen::Quaterniond moon_from_object = Eigen::Quaterniond::Identity();  // unit; the mesh's axes are its file's
  double scale = 1;                                                      // metres per unit of the file
  std::vector<Material> materials;                                       // one for each of the mesh's parts
};

}  // namespace selenograph::engine
