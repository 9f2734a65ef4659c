// "surface" and materials: reflectance and temperature of the ground and of objects. The only table of reflectance
// models is in the .cpp.
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

// Returns the equation of a reflectance model, with its normalisation.
std::string_view normalisation(engine::ReflectanceModel model);
// Returns how other tools normalise the models of the same names, for the API document.
std::string_view normalisation_elsewhere();

// Table of an object's material: {"reflectance", "temperature_k"}.
const Members<engine::Material>& material_members();

// The Moon's reflectance by name, instead of a model and its parameters.
enum class SurfacePreset { moon, moon_mare, moon_highlands, sato2014, sato2014_mare, sato2014_highlands };

// Members of "surface" that the engine's request no longer has: the preset, which is resolved once the band is read,
// and the maps' names.
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
// Convert between "surface" and the members of the engine's request.
Ground ground_of(const engine::FrameRequest& request, const SurfaceQuery& query);
void set_ground(engine::FrameRequest& request, SurfaceQuery& query, const Ground& ground);

// For a Sato et al. (2014) preset, sets the Hapke parameters at the band's centre wavelength (643 nm without a band).
void resolve_preset(engine::FrameRequest& request, const SurfaceQuery& query);

// Returns the metadata of the reflectance: its equation, and for the presets `moon*` its uncertainty and the share of
// sunlight for which it is extrapolated. Only frames report the phase angles in the image.
nlohmann::ordered_json reflectance_metadata(const engine::FrameRequest& request, const engine::FrameReport& report);
// Adds warnings about wavelengths and phase angles beyond a model's data, and about the default ground in frames whose
// radiometry is meant to be absolute.
void add_reflectance_warnings(const engine::FrameRequest& request, const SurfaceQuery& query,
                              const engine::FrameReport& report, nlohmann::ordered_json& warnings);

// Returns the metadata of maps: each map's name and version.
nlohmann::ordered_json maps_metadata(const engine::FrameRequest& request, const SurfaceQuery& query);

}  // namespace selenograph::api
