// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/parts/surface_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "api/json/ranges.h"
#include "engine/radiometry/brdf.h"
#include "engine/radiometry/moon.h"
#include "engine/radiometry/sato2014.h"

namespace selenograph::api {
namespace {

using engine::Material;
using engine::Reflectance;
using engine::ReflectanceModel;

struct ReflectanceRow {
  std::string_view word;
  engine::ReflectanceModel model;
  // The equation as printed in its paper, and its value relative to the other models.
  std::string_view normalisation;
};
constexpr ReflectanceRow kReflectanceModels[] = {
    {"lambert", ReflectanceModel::lambert,
     "f_r = rho / pi (SENSOR++ eq. 4), per steradian; radiance = E_sun * mu0 * f_r * lit"},
    {"lommel_seeliger", ReflectanceModel::lommel_seeliger,
     "f_r = rho / (2 pi) / (mu0 + mu) (SENSOR++ eq. 10 as printed), per steradian; radiance = E_sun * mu0 * f_r * "
     "lit; a quarter of Lambert's at mu0 = mu = 1"},
    {"lunar", ReflectanceModel::lommel_seeliger_lambert,
     "f_r = w * rho / (2 pi) / (mu0 + mu) + (1 - w) * rho / pi, w = lommel_seeliger_weight (SENSOR++ 3.1, eqs. 10 "
     "and 4), per steradian; radiance = E_sun * mu0 * f_r * lit"},
    {"blinn_phong", ReflectanceModel::blinn_phong,
     "f_r = rho / (8 pi) * (p + 4) (p + 2) / (p + 2^(-p/2)) * (n.h)^p, p = shininess, h halfway between Sun and "
     "camera (SENSOR++ eq. 11), per steradian; radiance = E_sun * mu0 * f_r * lit; reflects at most rho of what "
     "arrives, exactly rho from the zenith"},
    {"lunar_lambert", ReflectanceModel::lunar_lambert,
     "f_r = rho / pi * (2 L / (mu0 + mu) + 1 - L), L = limb_darkening, or, if left out, 1 - 0.019 g + 0.242e-3 g^2 - "
     "1.46e-6 g^3 of the phase angle g in degrees, not below 0 (McEwen 1991, 1996), per steradian; radiance = E_sun * "
     "mu0 * f_r * lit; equal to Lambert at mu0 = mu = 1, four times lommel_seeliger for L = 1: rho is a normal albedo"},
    {"hapke", ReflectanceModel::hapke,
     "f_r = w / (4 pi) / (mu0' + mu') * ((1 + B(g)) p(g) + H(mu0') H(mu') - 1) * S * mu0' / mu0, H(x) = (1 + 2x) / "
     "(1 + 2x sqrt(1 - w)), B(g) = b0 / (1 + tan(g/2) / h), mu0', mu' and S of roughness theta_bar (Hapke 1981, "
     "1984; `terms`: those of 2002 instead), per steradian: Hapke's bidirectional reflectance is mu0 f_r, I/F is pi "
     "mu0 f_r; radiance = E_sun * "
     "mu0 * f_r * lit"},
};

constexpr std::pair<std::string_view, engine::PhaseFunction> kPhaseFunctions[] = {
    {"legendre", engine::PhaseFunction::legendre},
    {"double_henyey_greenstein", engine::PhaseFunction::double_henyey_greenstein},
};

constexpr std::pair<std::string_view, engine::HapkeTerms> kHapkeTerms[] = {
    {"1984", engine::HapkeTerms::terms_1984},
    {"2002", engine::HapkeTerms::terms_2002},
};

constexpr std::pair<std::string_view, engine::PhaseLaw> kPhaseLaws[] = {
    {"none", engine::PhaseLaw::none},
    {"allen", engine::PhaseLaw::allen},
    {"rolo", engine::PhaseLaw::rolo},
};

constexpr std::pair<std::string_view, SurfacePreset> kSurfacePresets[] = {
    {"moon", SurfacePreset::moon},
    {"moon-mare", SurfacePreset::moon_mare},
    {"moon-highlands", SurfacePreset::moon_highlands},
    {"sato2014", SurfacePreset::sato2014},
    {"sato2014-mare", SurfacePreset::sato2014_mare},
    {"sato2014-highlands", SurfacePreset::sato2014_highlands},
};

// Text of the model that only the presets `moon*` use; it has no row above since clients cannot name it.
constexpr std::string_view kMoonNormalisation =
    "f_r = c(g) (2 L / (mu0 + mu) + 1 - L), L = 1 - 0.019 g + 0.242e-3 g^2 - 1.46e-6 g^3 of the phase angle g in "
    "degrees, not below 0 (McEwen 1996), per steradian; c(g) such that a uniform sphere has the disc-equivalent "
    "reflectance of LIME (Toledano et al. 2024; 0.44 to 1.64 um, 2 to 90 degrees), beyond in proportion to ROLO's "
    "(Kieffer & Stone 2005), averaged over the band's sunlight; radiance = E_sun * mu0 * f_r * lit";

constexpr const char* kNoRho = "\"hapke\" and the presets have no rho, which emission, B(T) (1 - rho), needs";

Words<ReflectanceModel> model_words() {
  static const auto words = [] {
    std::vector<std::pair<std::string_view, ReflectanceModel>> list;
    for (const ReflectanceRow& row : kReflectanceModels) list.emplace_back(row.word, row.model);
    return list;
  }();
  return words;
}

std::string reflectance_description() {
  std::string out = "The BRDF f_r; radiance is E_sun * mu0 * f_r * lit.\n";
  for (const ReflectanceRow& row : kReflectanceModels) out += fmt::format("\n- `{}`: {}", row.word, row.normalisation);
  return out + "\n\n" + std::string(normalisation_elsewhere());
}

// Reports parameters with which a model would reflect more than arrives, or a negative amount.
void check_reflectance(const JsonReader& in, Reflectance& reflectance, const ReadContext&) {
  if (reflectance.model == ReflectanceModel::lunar_lambert && reflectance.rho > engine::kLunarLambertMaxRho)
    in.fail("rho", fmt::format("must be at most {} for \"lunar_lambert\", whose rho is a normal albedo: more would "
                               "reflect more than arrives",
                               engine::kLunarLambertMaxRho));
  if (reflectance.model != ReflectanceModel::hapke || !in.good()) return;
  for (const char* name : {"bc0", "hc"})
    if (in.has(name) && reflectance.hapke.terms != engine::HapkeTerms::terms_2002)
      return in.fail(name, "needs \"terms\": \"2002\"");
  // Sample the phase function at every degree: where it is negative, the ground would absorb more light than arrives.
  for (int phase_deg = 0; phase_deg <= 180; ++phase_deg)
    if (engine::phase_function(reflectance.hapke, std::cos(phase_deg * kRadiansPerDegree)) < 0)
      return in.fail("c", fmt::format("with this b the phase function is negative at {} degrees", phase_deg));
}

// Returns the limit on rho of lunar_lambert as a schema condition.
OrderedJson rho_of_lunar_lambert(const Limits&) {
  return {{"if", {{"properties", {{"model", {{"const", "lunar_lambert"}}}}}, {"required", {"model"}}}},
          {"then", {{"properties", {{"rho", {{"maximum", engine::kLunarLambertMaxRho}}}}}}}};
}

// Returns the rule that "bc0" and "hc" need the terms of 2002 as a schema condition.
OrderedJson coherent_backscatter_of_2002(const Limits&) {
  return {{"if", {{"anyOf", {{{"required", {"bc0"}}}, {{"required", {"hc"}}}}}}},
          {"then", {{"properties", {{"terms", {{"const", "2002"}}}}}, {"required", {"terms"}}}}};
}

const Members<Reflectance>& reflectance_members() {
  static const auto table = make_table<Members<Reflectance>>("Reflectance", reflectance_description(), [](auto& m) {
    m.add("model", &Reflectance::model, Word<ReflectanceModel>{model_words()}, "the BRDF");
    m.set_model("model");
    m.add("rho", &Reflectance::rho, Number{kUnitInterval},
          fmt::format("rho of the equations; at most {} of \"lunar_lambert\"", engine::kLunarLambertMaxRho))
        .only_for({"lambert", "lommel_seeliger", "lunar", "blinn_phong", "lunar_lambert"});
    m.add("lommel_seeliger_weight", &Reflectance::lommel_seeliger_weight, Number{kUnitInterval},
          "w of the weighted average")
        .only_for({"lunar"});
    m.add("shininess", &Reflectance::shininess, Number{{0, 1e6}},
          "p of the equation: 0 is Lambert, large values a mirror")
        .only_for({"blinn_phong"});
    m.add("limb_darkening", &Reflectance::limb_darkening, Number{kUnitInterval},
          "L of the equation; left out: McEwen's L(g) of the phase angle")
        .only_for({"lunar_lambert"});
    m.add("phase", &Reflectance::phase, Word{kPhaseLaws},
          "phase law: a factor f(g) of f_r, f(0) = 1, such that the integrated light of a uniform sphere follows the "
          "Moon's: `allen`: magnitudes in the visible, 0.026 g + 4e-9 g^4 (Allen 1973), 0 to 150 degrees, constant "
          "beyond; `rolo`: reflectance at 0.554 um with the opposition surge (Kieffer & Stone 2005), 1.55 to 97 "
          "degrees, extrapolated to 0 and by `allen` beyond; `none`: 1. With `lunar_lambert` and McEwen's L(g), f(g) "
          "is his A(g)")
        .only_for({"lommel_seeliger", "lunar", "lunar_lambert"})
        .written_if([](const Reflectance& r) { return r.phase != engine::PhaseLaw::none; });
    const auto of_hapke = [&m](std::string_view name, auto engine::HapkeParameters::*field, auto kind,
                               std::string text) {
      return m.add(name, nested(&Reflectance::hapke, field), kind, std::move(text)).only_for({"hapke"});
    };
    using Hapke = engine::HapkeParameters;
    of_hapke("w", &Hapke::w, Number{kUnitInterval}, "single-scattering albedo");
    of_hapke("b0", &Hapke::b0, Number{{0, 10}}, "amplitude of the opposition surge, B_0");
    of_hapke("h", &Hapke::h, Number{above(0).to(10)}, "angular width of the opposition surge");
    of_hapke("b", &Hapke::b, Number{above(-1).below(1)}, "b of the phase function");
    of_hapke("c", &Hapke::c, Number{{-2, 3}}, "c of the phase function");
    of_hapke("theta_bar_deg", &Hapke::theta_bar_deg, Number{from(0).below(60), "deg"},
             "mean slope of the roughness below the mesh's resolution");
    of_hapke("phase_function", &Hapke::phase_function, Word{kPhaseFunctions},
             "1 + b cos g + c (3 cos^2 g - 1)/2, or two lobes of width b, weighted by c; negative nowhere");
    const auto of_2002 = [](const Reflectance& r) { return r.hapke.terms == engine::HapkeTerms::terms_2002; };
    of_hapke("terms", &Hapke::terms, Word{kHapkeTerms},
             "1984: isotropic multiple scattering, H(x) as above; 2002 (Hapke, Icarus 157, 523): multiple scattering "
             "that depends on p(g), H to 1 %, coherent backscatter")
        .written_if(of_2002);
    of_hapke("bc0", &Hapke::bc0, Number{kUnitInterval}, "amplitude of coherent backscatter; needs `terms` 2002")
        .written_if(of_2002);
    of_hapke("hc", &Hapke::hc, Number{above(0).to(10)}, "angular width of coherent backscatter; needs `terms` 2002")
        .written_if(of_2002);
    m.check(check_reflectance);
    m.add_condition(rho_of_lunar_lambert);
    m.add_condition(coherent_backscatter_of_2002);
  });
  return *table;
}

// Adds the rows of a material to the table of a form derived from Material.
template <typename Form>
void add_material(Members<Form>& m) {
  m.add("reflectance", &Form::reflectance, Object{reflectance_members()}, "the BRDF and its parameters")
      .written_if([](const Form& form) { return form.reflectance.model != ReflectanceModel::moon; });
  m.add("temperature_k", &Form::temperature_k, Number{kTemperature_k, "K"},
        "thermal emission B(T) (1 - rho) (SENSOR++ eq. 3); 0: none. Cannot be combined with `hapke` or a preset, which "
        "have no rho")
      .written_if([](const Form& form) { return form.temperature_k > 0; });
}

void check_material(const JsonReader& in, const Material& material) {
  if (material.temperature_k > 0 && !engine::has_rho(material.reflectance.model)) in.fail("temperature_k", kNoRho);
}

// Returns the reflectance of a preset. For Sato et al. it has no parameters yet: resolve_preset() sets them once the
// band is known.
Reflectance reflectance_of(SurfacePreset preset) {
  Reflectance reflectance{ReflectanceModel::hapke};
  switch (preset) {
    case SurfacePreset::moon_highlands:
      reflectance.ground = engine::MoonGround::highlands;
      reflectance.model = ReflectanceModel::moon;
      break;
    case SurfacePreset::moon_mare:
      reflectance.ground = engine::MoonGround::mare;
      reflectance.model = ReflectanceModel::moon;
      break;
    case SurfacePreset::moon:
      reflectance.model = ReflectanceModel::moon;
      break;
    case SurfacePreset::sato2014:
    case SurfacePreset::sato2014_mare:
    case SurfacePreset::sato2014_highlands:
      break;
  }
  return reflectance;
}

// Returns the preset from which a reflectance of the model `moon` came; empty for other models, which are written as
// `reflectance`.
std::optional<SurfacePreset> preset_of(const Reflectance& reflectance) {
  if (reflectance.model != ReflectanceModel::moon) return std::nullopt;
  switch (reflectance.ground) {
    case engine::MoonGround::mare:
      return SurfacePreset::moon_mare;
    case engine::MoonGround::highlands:
      return SurfacePreset::moon_highlands;
    case engine::MoonGround::mean:
      break;
  }
  return SurfacePreset::moon;
}

// Reports maps whose quantity (rho, w, radiance factor, kelvin) is not one that the model takes.
void check_quantities(const JsonReader& in, const Ground& ground) {
  const ReflectanceModel model = ground.reflectance.model;
  for (std::size_t i = 0; i < ground.albedo_maps.size(); ++i) {
    const auto& [name, map] = ground.albedo_maps[i];
    const bool has_radiance_factor = map->radiance_factor().has_value();
    if (model == ReflectanceModel::moon && !has_radiance_factor)
      in.at("albedo_maps")
          .fail(fmt::format(
              "maps/{}.json has no \"quantity\": a preset of the Moon takes maps of \"radiance_factor\", not of rho",
              name));
    if (model == ReflectanceModel::hapke && has_radiance_factor)
      in.at("albedo_maps")
          .fail(fmt::format("maps/{}.json holds \"radiance_factor\"; \"hapke\" takes maps of its w", name));
  }
  for (const auto& [name, map] : ground.temperature_maps)
    if (map->radiance_factor())
      in.at("temperature_maps").fail(fmt::format("maps/{}.json holds \"radiance_factor\", not kelvin", name));
}

// Resolves the preset to a reflectance, then checks temperature and maps against it.
void check_ground(const JsonReader& in, Ground& ground, const ReadContext&) {
  if (ground.preset) ground.reflectance = reflectance_of(*ground.preset);
  check_material(in, ground);
  if (in.has("temperature_maps") && !engine::has_rho(ground.reflectance.model)) in.fail("temperature_maps", kNoRho);
  check_quantities(in, ground);
}

const Asset<dem::ValueMap> kMap{&Assets::map, "map", "maps"}, kTemperatures{&Assets::temperature_map, "map", "maps"};

}  // namespace

std::string_view normalisation(ReflectanceModel model) {
  if (model == ReflectanceModel::moon) return kMoonNormalisation;
  for (const ReflectanceRow& row : kReflectanceModels)
    if (row.model == model) return row.normalisation;
  return "";
}

std::string_view normalisation_elsewhere() {
  return "Tools differ by factors of 2, 4 and pi in models of the same name. Check the equations before comparing "
         "radiances:\n- Lommel-Seeliger here (SENSOR++ eq. 10): `f_r = rho/(2 pi) / (mu0 + mu)`; at mu0 = mu = 1 it is "
         "rho/(4 pi), a quarter of Lambert's rho/pi;\n- Hapke, with an isotropic phase function and without multiple "
         "scattering: `f_r = w/(4 pi) / (mu0 + mu)`, half of `lommel_seeliger` for rho = w;\n- lunar-Lambert in ISIS's "
         "photomet is divided by its own value at mu0 = mu = 1 where an albedo is asked for, and Hapke there is the "
         "radiance factor I/F = pi mu0 f_r;\n- lunar-Lambert elsewhere is also written `A (L mu0/(mu0 + mu) + (1 - L) "
         "mu0)`, without the 2: half of ours for L = 1;\n- Hapke's double Henyey-Greenstein function has its lobes' "
         "weights as (1 + c)/2 and (1 - c)/2 here (Hapke 2012), as c and 1 - c in ISIS (Hg2) and in Hapke 1993, and "
         "either sign of b for backward;\n- Blinn-Phong in graphics is normalised by (p + 8)/(8 pi) (an approximation) "
         "or (p + 2)/(2 pi), or not at all: eq. 11's factor is exact for a Sun in the zenith;\n- tools that return I/F "
         "(radiance factor) are a factor of pi above f_r * mu0.";
}

const Members<Material>& material_members() {
  static const auto table = make_table<Members<Material>>("Material", "Surface material.", [](auto& m) {
    add_material(m);
    m.check([](const JsonReader& in, Material& material, const ReadContext&) { check_material(in, material); });
  });
  return *table;
}

const Members<Ground>& ground_members() {
  static const auto table = make_table<Members<Ground>>(
      "Surface",
      "The ground's reflectance and temperature: constants, or maps from the operator's assets folder. Maps are "
      "averaged over a pixel's footprint.",
      [](auto& m) {
        m.add("preset", &Ground::preset, Word{kSurfacePresets},
              "the Moon's own reflectance, instead of `reflectance`. `moon`, `moon-mare`, `moon-highlands`: in "
              "absolute units, by phase and wavelength, from its irradiance by LIME and ROLO, with McEwen's limb "
              "darkening; maps vary it from place to place. `sato2014`, `sato2014-mare`, `sato2014-highlands`: Hapke's "
              "parameters from images of the LROC WAC in the band (Sato et al. 2014; 0.321 to 0.689 um), written as "
              "`reflectance` in the resolved request");
        m.excludes("preset", {"reflectance"});
        add_material(m);
        m.add("albedo_maps", &Ground::albedo_maps, List{kMap, 1, kMaxMaps},
              "names of maps/NAME.json: rho, or w of `hapke`, from the first map that has a value at a point; where "
              "none has, the constant. At most 0.25 for `lunar_lambert`. A map of radiance factors becomes rho by the "
              "model, or with `moon` a ratio to the map's mean over the near side")
            .written_if([](const Ground& ground) { return !ground.albedo_maps.empty(); });
        m.add("temperature_maps", &Ground::temperature_maps, List{kTemperatures, 1, kMaxMaps, "K"},
              "names of maps/NAME.json: used in the same way, averaged as T^4; where none has a value, temperature_k")
            .written_if([](const Ground& ground) { return !ground.temperature_maps.empty(); });
        m.check(check_ground);
      });
  return *table;
}

Ground ground_of(const engine::FrameRequest& request, const SurfaceQuery& query) {
  Ground ground{{request.reflectance, request.temperature_k}, preset_of(request.reflectance), {}, {}};
  for (std::size_t i = 0; i < query.albedo_maps.size(); ++i)
    ground.albedo_maps.push_back({query.albedo_maps[i], request.albedo_maps[i]});
  for (std::size_t i = 0; i < query.temperature_maps.size(); ++i)
    ground.temperature_maps.push_back({query.temperature_maps[i], request.temperature_maps[i]});
  return ground;
}

void set_ground(engine::FrameRequest& request, SurfaceQuery& query, const Ground& ground) {
  request.reflectance = ground.reflectance;
  request.temperature_k = ground.temperature_k;
  query.preset = ground.preset;
  for (const auto& [name, map] : ground.albedo_maps) {
    query.albedo_maps.push_back(name);
    request.albedo_maps.push_back(map);
  }
  for (const auto& [name, map] : ground.temperature_maps) {
    query.temperature_maps.push_back(name);
    request.temperature_maps.push_back(map);
  }
}

void resolve_preset(engine::FrameRequest& request, const SurfaceQuery& query) {
  if (!query.preset || request.reflectance.model == ReflectanceModel::moon) return;
  constexpr double kDefaultBand_um = 0.643;  // without a band; add_reflectance_warnings() says so
  const auto region = *query.preset == SurfacePreset::sato2014_mare        ? engine::SatoRegion::mare
                      : *query.preset == SurfacePreset::sato2014_highlands ? engine::SatoRegion::highlands
                                                                           : engine::SatoRegion::global;
  request.reflectance.hapke = engine::sato2014(region, request.band ? request.band->center_um() : kDefaultBand_um);
}

namespace {

bool is_inside(const std::array<double, 2>& range, double min, double max) {
  return range[0] >= min && range[1] <= max;
}

// Returns true for the ground of a request without `surface`.
bool is_default(const engine::FrameRequest& request) {
  const engine::Reflectance& reflectance = request.reflectance;
  const engine::Reflectance standard;
  return reflectance.model == standard.model && reflectance.lommel_seeliger_weight == standard.lommel_seeliger_weight &&
         reflectance.rho == standard.rho && reflectance.phase == standard.phase && request.albedo_maps.empty();
}

// Returns true for frames whose numbers are meant to be a camera's or a radiometer's.
bool is_absolute(const engine::FrameRequest& request) {
  return request.sensor || request.image.full_scale_radiance_w_m2_sr ||
         (request.band && request.products & engine::kRadiance);
}

}  // namespace

nlohmann::ordered_json reflectance_metadata(const engine::FrameRequest& request, const engine::FrameReport& report) {
  nlohmann::ordered_json members{{"normalisation", normalisation(request.reflectance.model)}};
  if (request.reflectance.model != ReflectanceModel::moon) return members;
  const engine::MoonTrust trust = engine::moon_trust(engine::band_of(request));
  const auto& phase_deg = report.view.phase_deg;
  // LIME covers a smaller range of phase angles than ROLO, which is less certain.
  const bool by_lime = !phase_deg || is_inside(*phase_deg, engine::kLimeFirst_deg, engine::kLimeLast_deg);
  members["uncertainty"] = by_lime ? trust.uncertainty : engine::kRoloUncertainty;
  members["extrapolated_sunlight"] = trust.extrapolated_share;
  if (phase_deg) members["phase_deg"] = *phase_deg;
  return members;
}

void add_reflectance_warnings(const engine::FrameRequest& request, const SurfaceQuery& query,
                              const engine::FrameReport& report, nlohmann::ordered_json& warnings) {
  const ReflectanceModel model = request.reflectance.model;
  // True also for moon-mare and moon-highlands: Sato et al. give their ratio to the mean Moon.
  const bool by_sato = query.preset && *query.preset != SurfacePreset::moon;
  const double center_um = request.band ? request.band->center_um() : 0;
  if (by_sato && (center_um < engine::kSatoFirst_um || center_um > engine::kSatoLast_um))
    warnings.push_back(
        model == ReflectanceModel::moon
            ? "mare and highlands are told apart by Sato et al. 2014 from 0.321 to 0.689 um; beyond, their "
              "ratio to the mean Moon is that at the nearest of these"
        : request.band ? "the band's center is beyond 0.321 to 0.689 um, where Sato et al. 2014 have "
                         "parameters: those at the nearest of these are used"
                       : "without a band the parameters of Sato et al. 2014 at 0.643 um are used for all "
                         "wavelengths");
  if (is_default(request) && is_absolute(request))
    warnings.push_back(
        "the ground has the default reflectance, which is a round number and not as bright as the Moon: \"surface\": "
        "{\"preset\": \"moon\"} has the Moon's in absolute units");
  if (model == ReflectanceModel::moon) {
    constexpr double kMaxExtrapolatedShare = 0.1;
    if (engine::moon_trust(engine::band_of(request)).extrapolated_share > kMaxExtrapolatedShare)
      warnings.push_back(
          "the band reaches beyond 0.35 to 2.5 um, where the Moon's reflectance is extrapolated "
          "(reflectance.extrapolated_sunlight says how much of the light)");
    if (const auto& phase_deg = report.view.phase_deg;
        phase_deg && !is_inside(*phase_deg, engine::kRoloFirst_deg, engine::kRoloLast_deg))
      warnings.push_back(
          "phase angles in view are beyond the 1.55 to 97 degrees of the ROLO model, where the Moon's reflectance is "
          "extrapolated (reflectance.phase_deg says which)");
  }
}

nlohmann::ordered_json maps_metadata(const engine::FrameRequest& request, const SurfaceQuery& query) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  const auto add = [&](const auto& maps, const std::vector<std::string>& names) {
    for (std::size_t i = 0; i < maps.size(); ++i)
      list.push_back({{"name", names[i]}, {"version", fmt::format("{:016x}", maps[i]->fingerprint())}});
  };
  add(request.albedo_maps, query.albedo_maps);
  add(request.temperature_maps, query.temperature_maps);
  return list;
}

}  // namespace selenograph::api
