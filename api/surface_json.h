// What the ground reflects: JSON <-> engine::Reflectance, and the one table of which member belongs to which model.
#pragma once

#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "api/assets.h"
#include "api/json_reader.h"
#include "engine/frame/request.h"

namespace selenograph::api {

inline constexpr std::pair<std::string_view, engine::ReflectanceModel> kReflectanceModels[] = {
    {"lambert", engine::ReflectanceModel::lambert},
    {"lommel_seeliger", engine::ReflectanceModel::lommel_seeliger},
    {"lunar", engine::ReflectanceModel::lommel_seeliger_lambert},
    {"blinn_phong", engine::ReflectanceModel::blinn_phong},
    {"lunar_lambert", engine::ReflectanceModel::lunar_lambert},
    {"hapke", engine::ReflectanceModel::hapke},
};
std::string_view name_of(engine::ReflectanceModel model);

inline constexpr std::pair<std::string_view, engine::PhaseFunction> kPhaseFunctions[] = {
    {"legendre", engine::PhaseFunction::legendre},
    {"double_henyey_greenstein", engine::PhaseFunction::double_henyey_greenstein},
};

// A number of some of the models.
struct ReflectanceMember {
  std::string_view name;
  Range range;
  std::vector<engine::ReflectanceModel> models;
  const char* description;
  double& (*of)(engine::Reflectance& reflectance);
  bool belongs_to(engine::ReflectanceModel model) const;
};
std::span<const ReflectanceMember> reflectance_members();

// {"reflectance", "temperature_k"}, of an object.
engine::Material read_material(const JsonReader& in);
nlohmann::ordered_json material_json(const engine::Material& material);

// What a ground's maps were called by.
struct SurfaceQuery {
  std::vector<std::string> albedo_maps, temperature_maps;
};
inline constexpr std::size_t kMaxMaps = 16;  // of a kind

// The same and {"albedo_maps", "temperature_maps"}, of the ground. Fills in the request.
void read_surface(const JsonReader& in, const Assets& assets, engine::FrameRequest& request, SurfaceQuery& query);
nlohmann::ordered_json surface_json(const engine::FrameRequest& request, const SurfaceQuery& query);
// Of a frame's metadata: each map's name and version.
nlohmann::ordered_json maps_metadata(const engine::FrameRequest& request, const SurfaceQuery& query);

}  // namespace selenograph::api
