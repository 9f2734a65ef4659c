// Surfaces: reflectance, materials, the ground. The only table of reflectance models.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "api/schema/member_kinds.h"
#include "dem/value_maps/value_map.h"
#include "engine/frame/report.h"
#include "engine/frame/request.h"

namespace selenograph::api {

std::string_view normalisation(engine::ReflectanceModel model);
// How other tools normalise Lommel-Seeliger, for the API document.
std::string_view normalisation_elsewhere();

// {"reflectance", "temperature_k"}, of an object.
const Members<engine::Material>& material_members();

// The Moon's own reflectance by name, in the place of a model and its parameters.
enum class SurfacePreset { moon, moon_mare, moon_highlands, sato2014, sato2014_mare, sato2014_highlands };

// Names of the ground's maps in the request; its preset if that depends on the band.
struct SurfaceQuery {
  std::optional<SurfacePreset> preset;
  std::vector<std::string> albedo_maps, temperature_maps;
};
inline constexpr std::size_t kMaxMaps = 16;  // per kind

// Material of the ground, with maps.
struct Ground : engine::Material {
  std::optional<SurfacePreset> preset;
  std::vector<Named<dem::ValueMap>> albedo_maps, temperature_maps;
};
const Members<Ground>& ground_members();
Ground ground_of(const engine::FrameRequest& request, const SurfaceQuery& query);
void set_ground(engine::FrameRequest& request, SurfaceQuery& query, const Ground& ground);

// Sato's parameters in the request's band.
void resolve_preset(engine::FrameRequest& request, const SurfaceQuery& query);

// Metadata of the reflectance: its equation; of `moon` how far it is to be trusted. Phase angles in the image are those
// of a frame.
nlohmann::ordered_json reflectance_metadata(const engine::FrameRequest& request, const engine::FrameReport& report);
void add_reflectance_warnings(const engine::FrameRequest& request, const SurfaceQuery& query,
                              const engine::FrameReport& report, nlohmann::ordered_json& warnings);

// Metadata of maps: each map's name and version.
nlohmann::ordered_json maps_metadata(const engine::FrameRequest& request, const SurfaceQuery& query);

}  // namespace selenograph::api
