// "objects": triangle meshes of the assets folder, where they are and what they are made of.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "api/assets.h"
#include "api/json_reader.h"
#include "engine/frame/request.h"

namespace selenograph::api {

inline constexpr std::size_t kMaxObjects = 100;
inline constexpr Range kScale{1e-6, 1e6};

// What the engine's objects were called by.
struct ObjectQuery {
  std::string mesh;
  engine::Material material;
  std::map<std::string, engine::Material> part_materials;
};

// Fills request.objects and, one for each, `queries`.
void read_objects(const JsonReader& in, const Assets& assets, engine::FrameRequest& request,
                  std::vector<ObjectQuery>& queries);
nlohmann::ordered_json objects_json(const engine::FrameRequest& request, const std::vector<ObjectQuery>& queries);

// Of a frame's metadata: each object's mesh, its version and size.
nlohmann::ordered_json objects_metadata(const engine::FrameRequest& request, const std::vector<ObjectQuery>& queries);

}  // namespace selenograph::api
