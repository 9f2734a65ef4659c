// "objects": triangle meshes of the assets folder, where they are and what they are made of.
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

// Names of an object's mesh and materials in the request.
struct ObjectQuery {
  std::string mesh;
  engine::Material material;
  std::map<std::string, engine::Material> part_materials;
};

struct ObjectForm {
  Named<engine::ObjectMesh> mesh;
  ObjectPose pose;
  double scale = 1;
  engine::Material material;
  std::map<std::string, engine::Material> part_materials;
};
// An object for the engine, and as requested.
struct PlacedObject {
  engine::SceneObject object;
  ObjectQuery query;
};
const Members<ObjectForm, PlacedObject>& object_members();

// Metadata of objects: each object's mesh, its version and size.
nlohmann::ordered_json objects_metadata(const engine::FrameRequest& request, const std::vector<ObjectQuery>& queries);

}  // namespace selenograph::api
