// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/parts/objects_json.h"

#include <fmt/format.h>

#include <algorithm>

#include "api/requests/parts/surface_json.h"
#include "engine/visibility/objects/object_mesh.h"

namespace selenograph::api {
namespace {

std::string quoted(const std::vector<std::string>& names) {
  const std::vector<std::string_view> views(names.begin(), names.end());
  return quoted_list(views, " and ");
}

// Returns the object with a material for each part of its mesh; reports materials of parts that the mesh lacks.
std::optional<PlacedObject> resolve_object(const JsonReader& in, const ObjectForm& form, const ReadContext&) {
  const std::size_t before = in.faults();
  const std::vector<std::string>& parts = form.mesh.content->shape().parts;
  std::vector<engine::Material> materials(parts.size(), form.material);
  for (const auto& [name, material] : form.part_materials) {
    if (std::find(parts.begin(), parts.end(), name) == parts.end())
      in.fail("part_materials", fmt::format("has no part \"{}\"; the mesh's are {}", name, quoted(parts)));
    for (std::size_t i = 0; i < parts.size(); ++i)
      if (parts[i] == name) materials[i] = material;
  }
  if (in.faults() != before) return std::nullopt;
  return PlacedObject{
      {form.mesh.content, form.pose.position_m, form.pose.moon_from_object, form.scale, std::move(materials)},
      {form.mesh.name, form.material, form.part_materials}};
}

ObjectForm form_of(const PlacedObject& placed) {
  const auto& [object, query] = placed;
  return {{query.mesh, object.mesh},
          {object.position_m, object.moon_from_object},
          object.scale,
          query.material,
          query.part_materials};
}

}  // namespace

const Members<ObjectForm, PlacedObject>& object_members() {
  static const auto table = make_table<Members<ObjectForm, PlacedObject>>(
      "Object", "A triangle mesh in the operator's assets folder, two-sided. It casts and receives shadows.",
      [](auto& m) {
        m.add("mesh", &ObjectForm::mesh, Asset{&Assets::object, "mesh", "objects"},
              "name of objects/NAME.obj, .ply, .gltf or .glb")
            .required();
        m.add("pose", &ObjectForm::pose, Object{object_pose_members()}, "position and attitude of the object")
            .required();
        m.add("scale", &ObjectForm::scale, Number{kScale, "m"}, "metres per unit of the file");
        m.add("material", &ObjectForm::material, Object{material_members()},
              "material of all parts except those in part_materials")
            .required();
        m.add("part_materials", &ObjectForm::part_materials, Map{Object{material_members()}},
              "materials of parts, by the name of the part's material in the file")
            .written_if([](const ObjectForm& form) { return !form.part_materials.empty(); });
        m.resolve(resolve_object);
        m.unresolve([](const PlacedObject& placed) { return form_of(placed); });
      });
  return *table;
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
