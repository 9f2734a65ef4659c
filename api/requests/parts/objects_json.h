// "objects": triangle meshes of the assets folder with their poses, scales and materials.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "api/requests/parts/pose_json.h"
#include "api/schema/member_kinds.h"
#include "engine/frame/request.h"

namespace selenograph::api {

inline constexpr std::size_t kMaxObjects = 100;
inline constexpr Range kScale{1e-6, 1e6};

// Members of an object that the engine's object no longer has: the mesh's name, and materials by part name.
struct ObjectQuery {
  std::string mesh;
  engine::Material material;
  std::map<std::string, engine::Material> part_materials;
};

// An object as a client writes it. Its material applies to all parts except those in part_materials.
struct ObjectForm {
  Named<engine::ObjectMesh> mesh;
  ObjectPose pose;
  double scale = 1;
  engine::Material material;
  std::map<std::string, engine::Material> part_materials;
};
// An object resolved for the engine, with the names from which its JSON is written again.
struct PlacedObject {
  engine::SceneObject object;
  ObjectQuery query;
};
const Members<ObjectForm, PlacedObject>& object_members();

// Returns the metadata of objects: each object's mesh, version, number of triangles and parts.
nlohmann::ordered_json objects_metadata(const engine::FrameRequest& request, const std::vector<ObjectQuery>& queries);

}  // namespace selenograph::api
