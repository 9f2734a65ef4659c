#include "api/surface_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "api/ranges.h"
#include "engine/radiometry/brdf.h"

namespace selenograph::api {
namespace {

using engine::Reflectance;
using engine::ReflectanceModel;

constexpr const char* kNoRho = "the model \"hapke\" has no rho, which albedo is and emission, B(T) (1 - rho), needs";

std::vector<ReflectanceMember> make_members() {
  using M = ReflectanceModel;
  return {
      {"rho",
       kUnitInterval,
       {M::lambert, M::lommel_seeliger, M::lommel_seeliger_lambert, M::blinn_phong, M::lunar_lambert},
       "rho of the equations",
       [](Reflectance& r) -> double& { return r.rho; }},
      {"lommel_seeliger_weight",
       kUnitInterval,
       {M::lommel_seeliger_lambert},
       "w of the weighted average",
       [](Reflectance& r) -> double& { return r.lommel_seeliger_weight; }},
      {"shininess",
       kShininess,
       {M::blinn_phong},
       "p of the equation: 0 is Lambert, a mirror has a large one",
       [](Reflectance& r) -> double& { return r.shininess; }},
      {"w", kUnitInterval, {M::hapke}, "single-scattering albedo", [](Reflectance& r) -> double& { return r.hapke.w; }},
      {"b0",
       kOppositionAmplitude,
       {M::hapke},
       "amplitude of the opposition surge, B_0",
       [](Reflectance& r) -> double& { return r.hapke.b0; }},
      {"h",
       kOppositionWidth,
       {M::hapke},
       "angular width of the opposition surge",
       [](Reflectance& r) -> double& { return r.hapke.h; }},
      {"b", kPhaseB, {M::hapke}, "b of the phase function", [](Reflectance& r) -> double& { return r.hapke.b; }},
      {"c", kPhaseC, {M::hapke}, "c of the phase function", [](Reflectance& r) -> double& { return r.hapke.c; }},
      {"theta_bar_deg",
       kRoughness_deg,
       {M::hapke},
       "mean slope of the roughness that the mesh doesn't resolve",
       [](Reflectance& r) -> double& { return r.hapke.theta_bar_deg; }},
  };
}

// Members that are no plain numbers, and whose they are.
constexpr std::pair<std::string_view, ReflectanceModel> kOthers[] = {
    {"limb_darkening", ReflectanceModel::lunar_lambert}, {"phase_function", ReflectanceModel::hapke}};

std::string models_with(const ReflectanceMember& member) {
  std::string names;
  for (const ReflectanceModel model : member.models)
    names += fmt::format("{}\"{}\"", names.empty() ? "" : ", ", name_of(model));
  return names;
}

void refuse_foreign_members(const JsonReader& in, ReflectanceModel model) {
  for (const ReflectanceMember& member : reflectance_members())
    if (!member.belongs_to(model) && in.has(member.name))
      in.fail(member.name, fmt::format("belongs to {}, not to \"{}\"", models_with(member), name_of(model)));
  for (const auto& [name, owner] : kOthers)
    if (owner != model && in.has(name))
      in.fail(name, fmt::format("belongs to \"{}\", not to \"{}\"", name_of(owner), name_of(model)));
}

void read_hapke(const JsonReader& in, engine::HapkeParameters& hapke) {
  hapke.phase_function = in.word("phase_function", Words<engine::PhaseFunction>(kPhaseFunctions), hapke.phase_function);
  if (!in.good()) return;
  for (int phase_deg = 0; phase_deg <= 180; ++phase_deg)
    if (engine::phase_function(hapke, std::cos(phase_deg * kRadiansPerDegree)) < 0) {
      in.fail("c", fmt::format("with this b the phase function is negative at {} degrees", phase_deg));
      return;
    }
}

Reflectance read_reflectance(const JsonReader& in) {
  Reflectance reflectance;
  if (!in.object({"model", "rho", "lommel_seeliger_weight", "shininess", "limb_darkening", "w", "b0", "h",
                  "phase_function", "b", "c", "theta_bar_deg"}))
    return reflectance;
  reflectance.model = in.word("model", Words<ReflectanceModel>(kReflectanceModels), reflectance.model);
  refuse_foreign_members(in, reflectance.model);
  for (const ReflectanceMember& member : reflectance_members()) {
    double& value = member.of(reflectance);
    value = in.number(member.name, member.range, value);
  }
  if (in.has("limb_darkening")) reflectance.limb_darkening = in.number("limb_darkening", kUnitInterval);
  if (reflectance.model == ReflectanceModel::lunar_lambert && reflectance.rho > engine::kLunarLambertMaxRho)
    in.fail("rho", fmt::format("must be at most {} for \"lunar_lambert\", whose rho is a normal albedo: more would "
                               "reflect more than arrives",
                               engine::kLunarLambertMaxRho));
  if (reflectance.model == ReflectanceModel::hapke) read_hapke(in, reflectance.hapke);
  return reflectance;
}

nlohmann::ordered_json reflectance_json(const Reflectance& reflectance) {
  nlohmann::ordered_json json{{"model", name_of(reflectance.model)}};
  Reflectance copy = reflectance;
  for (const ReflectanceMember& member : reflectance_members())
    if (member.belongs_to(reflectance.model)) json[std::string(member.name)] = member.of(copy);
  if (reflectance.model == ReflectanceModel::lunar_lambert && reflectance.limb_darkening)
    json["limb_darkening"] = *reflectance.limb_darkening;
  if (reflectance.model == ReflectanceModel::hapke)
    json["phase_function"] = word_of(kPhaseFunctions, reflectance.hapke.phase_function);
  return json;
}

}  // namespace

std::string_view name_of(ReflectanceModel model) { return word_of(kReflectanceModels, model); }

bool ReflectanceMember::belongs_to(ReflectanceModel model) const {
  return std::find(models.begin(), models.end(), model) != models.end();
}

std::span<const ReflectanceMember> reflectance_members() {
  static const std::vector<ReflectanceMember> members = make_members();
  return members;
}

namespace {

engine::Material read_members(const JsonReader& in) {
  engine::Material material;
  if (in.has("reflectance")) material.reflectance = read_reflectance(in.at("reflectance"));
  material.temperature_k = in.number("temperature_k", kTemperature_k, 0);
  if (material.temperature_k > 0 && material.reflectance.model == ReflectanceModel::hapke)
    in.fail("temperature_k", kNoRho);
  return material;
}

void read_maps(const JsonReader& in, const Assets& assets, std::vector<std::shared_ptr<const dem::ValueMap>>& maps,
               std::vector<std::string>& names) {
  in.elements(1, kMaxMaps, [&](const JsonReader& element) {
    const std::optional<std::string> name = element.text();
    if (!name) return;
    auto map = assets.map(*name);
    if (!map) return element.fail("no such map; the service has " + listed(assets.names("maps")));
    maps.push_back(std::move(map)), names.push_back(*name);
  });
}

}  // namespace

engine::Material read_material(const JsonReader& in) {
  return in.object({"reflectance", "temperature_k"}) ? read_members(in) : engine::Material();
}

void read_surface(const JsonReader& in, const Assets& assets, engine::FrameRequest& request, SurfaceQuery& query) {
  if (!in.object({"reflectance", "temperature_k", "albedo_maps", "temperature_maps"})) return;
  const engine::Material ground = read_members(in);
  request.reflectance = ground.reflectance, request.temperature_k = ground.temperature_k;
  for (const char* maps : {"albedo_maps", "temperature_maps"})
    if (in.has(maps) && ground.reflectance.model == ReflectanceModel::hapke) in.fail(maps, kNoRho);
  if (in.has("albedo_maps")) read_maps(in.at("albedo_maps"), assets, request.albedo_maps, query.albedo_maps);
  if (in.has("temperature_maps"))
    read_maps(in.at("temperature_maps"), assets, request.temperature_maps, query.temperature_maps);
}

nlohmann::ordered_json material_json(const engine::Material& material) {
  nlohmann::ordered_json json{{"reflectance", reflectance_json(material.reflectance)}};
  if (material.temperature_k > 0) json["temperature_k"] = material.temperature_k;
  return json;
}

nlohmann::ordered_json surface_json(const engine::FrameRequest& request, const SurfaceQuery& query) {
  nlohmann::ordered_json json = material_json({request.reflectance, request.temperature_k});
  if (!query.albedo_maps.empty()) json["albedo_maps"] = query.albedo_maps;
  if (!query.temperature_maps.empty()) json["temperature_maps"] = query.temperature_maps;
  return json;
}

nlohmann::ordered_json maps_metadata(const engine::FrameRequest& request, const SurfaceQuery& query) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  const auto add = [&](const auto& maps, const std::vector<std::string>& names) {
    for (std::size_t i = 0; i < maps.size(); ++i)
      list.push_back({{"name", names[i]}, {"version", fmt::format("{:016x}", maps[i]->fingerprint())}});
  };
  add(request.albedo_maps, query.albedo_maps), add(request.temperature_maps, query.temperature_maps);
  return list;
}

}  // namespace selenograph::api
