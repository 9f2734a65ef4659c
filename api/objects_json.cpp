#include "api/objects_json.h"

#include <fmt/format.h>

#include <algorithm>

#include "api/frame_json.h"
#include "api/ranges.h"
#include "api/surface_json.h"
#include "engine/visibility/object_mesh.h"

namespace selenograph::api {
namespace {

using OrderedJson = nlohmann::ordered_json;

std::string quoted(const std::vector<std::string>& names) {
  const std::vector<std::string_view> views(names.begin(), names.end());
  return quoted_list(views, " and ");
}

void read_part_materials(const JsonReader& in, const engine::ObjectMesh& mesh, ObjectQuery& query,
                         engine::SceneObject& object) {
  if (!in.value().is_object()) return in.fail("must be an object: a material for each part that has its own");
  const std::vector<std::string>& parts = mesh.shape().parts;
  for (const auto& [name, value] : in.value().items()) {
    if (std::find(parts.begin(), parts.end(), name) == parts.end()) {
      in.fail(fmt::format("has no part \"{}\"; the mesh's are {}", name, quoted(parts)));
      continue;
    }
    const engine::Material material = read_material(in.at(name));
    for (std::size_t i = 0; i < parts.size(); ++i)
      if (parts[i] == name) object.materials[i] = material;
    query.part_materials[name] = material;
  }
}

std::shared_ptr<const engine::ObjectMesh> read_mesh(const JsonReader& in, const Assets& assets, ObjectQuery& query) {
  if (!in.has("mesh")) {
    in.fail("mesh", "is required");
    return nullptr;
  }
  const JsonReader named = in.at("mesh");
  const auto name = named.text();
  if (!name) return nullptr;
  query.mesh = *name;
  auto mesh = assets.object(*name);
  if (!mesh) named.fail("no such mesh; the service has " + listed(assets.names("objects")));
  return mesh;
}

void read_object(const JsonReader& in, const Assets& assets, engine::SceneObject& object, ObjectQuery& query) {
  if (!in.object({"mesh", "pose", "scale", "material", "part_materials"})) return;
  object.mesh = read_mesh(in, assets, query);
  object.scale = in.number("scale", kScale, 1);
  if (!in.has("pose")) in.fail("pose", "is required");
  if (in.has("pose")) read_object_pose(in.at("pose"), object);
  if (!in.has("material")) in.fail("material", "is required");
  if (in.has("material")) query.material = read_material(in.at("material"));
  if (!object.mesh) return;
  object.materials.assign(object.mesh->shape().parts.size(), query.material);
  if (in.has("part_materials")) read_part_materials(in.at("part_materials"), *object.mesh, query, object);
}

}  // namespace

void read_objects(const JsonReader& in, const Assets& assets, engine::FrameRequest& request,
                  std::vector<ObjectQuery>& queries) {
  in.elements(1, kMaxObjects, [&](const JsonReader& element) {
    read_object(element, assets, request.objects.emplace_back(), queries.emplace_back());
  });
}

OrderedJson objects_json(const engine::FrameRequest& request, const std::vector<ObjectQuery>& queries) {
  OrderedJson list = OrderedJson::array();
  for (std::size_t i = 0; i < queries.size(); ++i) {
    const engine::SceneObject& object = request.objects[i];
    OrderedJson json{{"mesh", queries[i].mesh},
                     {"pose", object_pose_json(object)},
                     {"scale", object.scale},
                     {"material", material_json(queries[i].material)}};
    for (const auto& [part, material] : queries[i].part_materials)
      json["part_materials"][part] = material_json(material);
    list.push_back(std::move(json));
  }
  return list;
}

OrderedJson objects_metadata(const engine::FrameRequest& request, const std::vector<ObjectQuery>& queries) {
  OrderedJson list = OrderedJson::array();
  for (std::size_t i = 0; i < queries.size(); ++i) {
    const engine::ObjectMesh& mesh = *request.objects[i].mesh;
    list.push_back({{"mesh", queries[i].mesh},
                    {"version", fmt::format("{:016x}", mesh.fingerprint())},
                    {"triangles", mesh.shape().triangles.size()},
                    {"parts", mesh.shape().parts}});
  }
  return list;
}

}  // namespace selenograph::api
