// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/parts/sky_options_json.h"

#include <fmt/format.h>

#include "api/json/ranges.h"
#include "api/schema/member_kinds.h"
#include "dem/base/error.h"
#include "engine/sky/sky_observer.h"
#include "engine/sky/star_catalogue.h"

namespace selenograph::api {
namespace {

using engine::BodyState;
using engine::BodyStates;
using engine::SkyOptions;
using engine::StarCatalogue;

constexpr Range kMagnitude{-2, 30};

// "stars": a catalogue's name, true for kBrightStars, or false for none.
struct Stars {
  using Value = std::shared_ptr<const StarCatalogue>;
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const {
    if (!in.value().is_boolean()) {
      const auto named = Asset{&Assets::stars, "star catalogue", "stars"}.read(in, context);
      return named ? std::optional<Value>(named->content) : std::nullopt;
    }
    if (!in.value().get<bool>()) return Value();
    if (Value bright = context.assets.stars(kBrightStars, context.stop)) return bright;
    in.fail(fmt::format("stands for the star catalogue \"{}\", which the service does not have; it has {}",
                        kBrightStars, listed(context.assets.names("stars"))));
    return std::nullopt;
  }
  OrderedJson write(const Value& stars) const { return stars ? OrderedJson(stars->name()) : OrderedJson(false); }
  OrderedJson schema(const Limits&) const {
    return {{"anyOf", OrderedJson::array({{{"type", "boolean"}}, {{"type", "string"}}})}};
  }
};

const Members<BodyState>& body_state_members() {
  static const auto table = make_table<Members<BodyState>>(
      "BodyState",
      "State of a body's centre relative to the Moon's, ICRF axes, as SPICE's spkezr has it with the correction "
      "\"LT\", "
      "in metres: the Moon at the epoch, the body when the light left that reaches the Moon's centre then.",
      [](auto& m) {
        m.add("position_m", &BodyState::position_m, Vector{kAnyNumber, "m"},
              "position of the body; within 1 % of its distance from where the service has it")
            .required();
        m.add("velocity_m_s", &BodyState::velocity_m_s, kVelocity_m_s,
              "velocity of the body: the light that reaches the camera left a little earlier or later than that to the "
              "Moon's centre")
            .required();
      });
  return *table;
}

// Returns the row of a body in "states".
auto state_of(std::string_view body) {
  return Property{[body](const BodyStates& states) {
                    const auto found = states.find(body);
                    return found == states.end() ? std::nullopt : std::optional(found->second);
                  },
                  [body](BodyStates& states, const BodyState& state) { states.emplace(body, state); }};
}

const Members<BodyStates>& body_states_members() {
  static const auto table = make_table<Members<BodyStates>>(
      "BodyStates", "States of the Sun, the Earth and planets from an ephemeris.", [](auto& m) {
        const auto add = [&m](std::string_view body, const char* meaning) {
          m.add(body, state_of(body), Object{body_state_members()}, meaning);
        };
        add("sun", "the Sun's");
        add("earth", "the Earth's; it counts also where the Earth only hides other objects");
        for (const engine::Planet planet : engine::other_planets()) add(planet_name(planet), "the planet's");
      });
  return *table;
}

// Reports states that nothing uses, and those that are far from where the service has the body: in kilometres, say, or
// relative to the Earth.
void check_states(const JsonReader& in, const SkyOptions& options) {
  const engine::SkyObserver moon(options.utc, Vec3::zero(), Vec3::zero());
  const auto check = [&](std::string_view name, bool is_used, const char* flag, const auto& theory) {
    const auto found = options.states.find(name);
    if (found == options.states.end()) return;
    if (!is_used) in.at("states").fail(name, fmt::format("requires \"{}\": true", flag));
    const engine::ApparentBody body = theory();
    constexpr double kMaxDifference = 0.01;
    const double difference =
        (found->second.position_m - body.distance_m * body.from_observer).norm() / body.distance_m;
    if (difference > kMaxDifference)
      in.at("states").at(name).fail(
          "position_m",
          fmt::format("is {:.3g} times the body's distance away from where the service has it at the epoch; "
                      "expected metres from the Moon's centre, ICRF axes",
                      difference));
  };
  check("sun", options.sun, "sun", [&] { return moon.sun(); });
  check("earth", true, "earth", [&] { return moon.planet(engine::Planet::earth); });
  for (const engine::Planet planet : engine::other_planets())
    check(planet_name(planet), options.planets, "planets", [&] { return moon.planet(planet); });
}

// Returns the options with their epoch, the sky's own or the Sun's, and with the velocity in MOON_ME.
std::optional<SkyOptions> resolve_sky(const JsonReader& in, const SkyForm& form, const ReadContext& context) {
  SkyOptions options = form.options;
  if (form.earth_map) {
    options.earth_map = {form.earth_map->name, form.earth_map->content};
    if (!options.earth) in.fail("earth_map", "requires \"earth\": true");
  }
  try {
    options.utc = form.utc || form.et_s ? form.as_utc() : context.sun_utc;
    if (options.utc.empty()) {
      in.fail("needs an epoch: \"utc\" or \"et_s\" here, or of the Sun");
      return std::nullopt;
    }
    if (!options.states.empty()) check_states(in, options);
    const Mat3 moon_me_from_icrf = engine::moon_me_from_icrf(options.utc);
    if (form.velocity_m_s)
      options.velocity_m_s =
          (form.velocity_frame ? engine::moon_me_from(*form.velocity_frame) : moon_me_from_icrf) * *form.velocity_m_s;
  } catch (const ImpossibleRequest& e) {
    // Report only an epoch of the sky itself: the Sun's is reported by sun_members().
    if (form.utc || form.et_s) in.fail(form.member(), e.what());
    return std::nullopt;
  }
  return options;
}

SkyForm form_of(const SkyOptions& options) {
  SkyForm form;
  form.utc = options.utc;
  form.options = options;
  if (options.velocity_m_s != Vec3::zero()) form.velocity_m_s = options.velocity_m_s;
  if (options.earth_map.content) form.earth_map = {options.earth_map.name, options.earth_map.content};
  return form;
}

}  // namespace

const Members<SkyForm, SkyOptions>& sky_members() {
  static const auto table = make_table<Members<SkyForm, SkyOptions>>(
      "Sky",
      "Objects in view besides the Moon, at their apparent places at an epoch. The Earth hides objects behind it, "
      "whether it is shown or not. A pose in the Moon's frames places the sky to the 0.01 degrees of the model of the "
      "Moon's rotation, one in ICRF of the same epoch exactly; with another epoch, the sky turns with the Moon "
      "meanwhile, and the answer warns where this is visible.",
      [](auto& m) {
        m.add("utc", &SkyForm::utc, Text{}, "epoch, ISO 8601; left out: the Sun's, or that of POST /v1/sky");
        m.add("et_s", &SkyForm::et_s, Number{kAnyNumber, "s"}, std::string(kEtMeaning));
        m.add("stars", nested(&SkyForm::options, &SkyOptions::stars), Stars{},
              "name of stars/NAME.csv in the operator's assets folder; true: the catalogue `bright`");
        m.add("magnitude_limit", nested(&SkyForm::options, &SkyOptions::magnitude_limit), Number{kMagnitude},
              "V magnitude of the faintest stars; at most 100 000 stars may be in view");
        m.add("sun", nested(&SkyForm::options, &SkyOptions::sun), Flag{}, "the Sun");
        m.add("earth", nested(&SkyForm::options, &SkyOptions::earth), Flag{}, "the Earth");
        m.add("earth_map", &SkyForm::earth_map, Asset{&Assets::map, "map", "maps"},
              "name of maps/NAME.json in the operator's assets folder, a map of the Earth's reflectance without "
              "georeferencing, by geodetic latitude: it modulates the brightness of the disc in frames, and the whole "
              "keeps its magnitude; left out: a uniform Earth");
        m.add("planets", nested(&SkyForm::options, &SkyOptions::planets), Flag{}, "the seven other planets, as points");
        m.add("states", nested(&SkyForm::options, &SkyOptions::states), Object{body_states_members()},
              "where an ephemeris of yours has bodies, instead of the service's theories: to 0.001 arcsec in "
              "direction_icrf. The Python client takes them from SPICE kernels (`Kernels.sky_states`)");
        m.add("velocity_m_s", &SkyForm::velocity_m_s, kVelocity_m_s,
              "velocity of the camera relative to the Moon's centre, in inertial space, without the Moon's rotation: "
              "1.5 km/s move the stars by 1 arcsec. Left out: that of the Moon");
        m.add("velocity_frame", &SkyForm::velocity_frame, Word<PoseFrame>{kPoseFrames, kRejectedFrames},
              "frame of velocity_m_s");
        m.excludes("utc", {"et_s"});
        m.resolve(resolve_sky);
        m.unresolve([](const SkyOptions& options) { return form_of(options); });
      });
  return *table;
}

}  // namespace selenograph::api
