// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/parts/indirect_json.h"

#include "api/json/ranges.h"
#include "api/requests/parts/pose_json.h"
#include "api/schema/member_kinds.h"
#include "dem/base/error.h"
#include "engine/sky/ephemeris.h"

namespace selenograph::api {
namespace {

using engine::Earth;
using engine::IndirectLight;

constexpr Range kEarthDistance_m{1e7, 1e12}, kSpacing_px{0.25, 64};

// Returns the Earth by a direction, by its sub-Earth point or at the Sun's epoch; empty, and reported, without any.
std::optional<Earth> resolve_earth(const JsonReader& in, const EarthForm& form, const ReadContext& context) {
  Earth earth;
  if (form.direction) {
    const std::optional<Vec3> direction = direction_member(in, *form.direction);
    if (!direction) return std::nullopt;
    earth.direction = *direction;
  } else if (form.sub_earth) {
    earth.direction = to_cartesian(*form.sub_earth).normalized();
  } else if (context.sun_utc.empty()) {
    in.fail("needs an epoch as \"sun.utc\" or \"sun.et_s\", or {\"direction\": ...} or {\"sub_earth\": ...}");
    return std::nullopt;
  } else {
    try {
      earth = engine::earth_at(context.sun_utc);
    } catch (const ImpossibleRequest&) {
      return std::nullopt;  // sun_members() reports the same epoch
    }
  }
  earth.distance_m = form.distance_m.value_or(earth.distance_m);
  return earth;
}

const Members<EarthForm, Earth>& earth_members() {
  static const auto table = make_table<Members<EarthForm, Earth>>(
      "Earth", "Position of the Earth, MOON_ME. Without `direction` and `sub_earth`: at the Sun's epoch.", [](auto& m) {
        m.add("direction", &EarthForm::direction, Vector{kAnyNumber}, "toward the Earth; any length but zero");
        m.add("sub_earth", &EarthForm::sub_earth, Object{place_members()}, "the sub-Earth point");
        m.add("distance_m", &EarthForm::distance_m, Number{kEarthDistance_m, "m"},
              "between the centres; default: 384 400 km, with an epoch from the ephemeris");
        m.excludes("direction", {"sub_earth"}, "that is a direction, too");
        m.resolve(resolve_earth);
        m.unresolve([](const Earth& earth) { return EarthForm{earth.direction, std::nullopt, earth.distance_m}; });
      });
  return *table;
}

// "earth": an object, true for the Earth at the Sun's epoch, or false for none.
struct FlagOrEarth {
  using Value = std::optional<Earth>;
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const {
    if (in.value().is_boolean() && !in.value().get<bool>()) return Value();
    const auto earth = in.value().is_boolean() ? resolve_earth(in, {}, context) : earth_members().read(in, context);
    return earth ? std::optional<Value>(earth) : std::nullopt;
  }
  OrderedJson write(const Value& earth) const { return earth ? earth_members().write(*earth) : OrderedJson(false); }
  OrderedJson schema(const Limits&) const {
    return {{"anyOf", OrderedJson::array({{{"type", "boolean"}}, reference_to(earth_members())})}};
  }
  std::vector<const MemberTable*> objects() const { return {&earth_members()}; }
};

}  // namespace

const Members<IndirectLight>& indirect_members() {
  static const auto table = make_table<Members<IndirectLight>>(
      "IndirectLight", "Indirect light: adds to the radiance of lit and shadowed ground.", [](auto& m) {
        m.add("terrain", &IndirectLight::terrain, Flag{},
              "sunlight reflected onto a point by the terrain visible from it, with the frame's reflectance, albedo "
              "maps and shadows; fades out in pixels of 0.5 to 1 km");
        m.add("bounces", &IndirectLight::bounces, Integer{1, 3},
              "number of reflections by terrain; 2 and 3 add light reflected by ground that other ground lights");
        m.add("spacing_px", &IndirectLight::spacing_px, Number{kSpacing_px, "px"},
              "spacing in the image of the posts at which light is gathered and interpolated, on rough ground a "
              "quarter of it, but no less than 1; at least the terrain's post spacing or, for values below 1, half of "
              "it");
        m.add("earth", &IndirectLight::earth, FlagOrEarth{},
              "earthlight, with shadows; true: the Earth at the epoch of `sun`. It comes from where the Moon's centre "
              "sees the "
              "Earth: up to 0.9 % too weak or too strong, and 0.26 degrees off");
      });
  return *table;
}

}  // namespace selenograph::api
