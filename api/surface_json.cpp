#include "api/surface_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "api/ranges.h"
#include "engine/brdf.h"

namespace selenograph::api {
namespace {

using engine::Reflectance;
using engine::ReflectanceModel;

std::vector<ReflectanceMember> make_members() {
  using M = ReflectanceModel;
  return {
      {"rho",
       kUnitInterval,
       {M::lambert, M::lommel_seeliger, M::lunar, M::blinn_phong, M::lunar_lambert},
       "rho of the equations",
       [](Reflectance& r) -> double& { return r.rho; }},
      {"lommel_seeliger_weight",
       kUnitInterval,
       {M::lunar},
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
    if (engine::phase_function(hapke, std::cos(phase_deg * kRadians)) < 0) {
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
  if (reflectance.model == ReflectanceModel::lunar_lambert && reflectance.rho > kLunarLambertMaxRho)
    in.fail("rho", fmt::format("must be at most {} for \"lunar_lambert\", whose rho is a normal albedo: more would "
                               "reflect more than arrives",
                               kLunarLambertMaxRho));
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

engine::Material read_material(const JsonReader& in) {
  engine::Material material;
  if (!in.object({"reflectance", "temperature_k"})) return material;
  if (in.has("reflectance")) material.reflectance = read_reflectance(in.at("reflectance"));
  material.temperature_k = in.number("temperature_k", kTemperature_k, 0);
  if (material.temperature_k > 0 && material.reflectance.model == ReflectanceModel::hapke)
    in.fail("temperature_k", "emission is B(T) (1 - rho), and the model \"hapke\" has no rho");
  return material;
}

nlohmann::ordered_json material_json(const engine::Material& material) {
  nlohmann::ordered_json json{{"reflectance", reflectance_json(material.reflectance)}};
  if (material.temperature_k > 0) json["temperature_k"] = material.temperature_k;
  return json;
}

}  // namespace selenograph::api
