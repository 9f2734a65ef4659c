// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/parts/sun_json.h"

#include <fmt/format.h>

#include "api/json/ranges.h"
#include "api/schema/member_kinds.h"
#include "dem/base/error.h"
#include "engine/sky/ephemeris.h"

namespace selenograph::api {
namespace {

using engine::Sun;

const Members<SunLocal>& local_members() {
  static const auto table = make_table<Members<SunLocal>>(
      "SunLocal", "The Sun as seen from a place on the sphere of 1 737 400 m.", [](auto& m) {
        add_latitude_and_longitude(m);
        m.add("azimuth_deg", &SunLocal::azimuth_deg, Number{kAzimuth_deg, "deg"}, "clockwise from north").required();
        m.add("elevation_deg", &SunLocal::elevation_deg, Number{kElevation_deg, "deg"}, "above the local horizontal")
            .required();
      });
  return *table;
}

// Returns the Sun by the one direction that the form has. An epoch ("utc" or "et_s") also gives the distance and,
// unless the form has a size, the size of the disc.
std::optional<Sun> resolve_sun(const JsonReader& in, const SunForm& form, const ReadContext&) {
  Sun sun;
  if (form.direction) {
    const std::optional<Vec3> direction = direction_member(in, *form.direction);
    if (!direction) return std::nullopt;
    sun.direction = *direction;
  }
  if (form.subsolar) sun.direction = to_cartesian(*form.subsolar).normalized();
  if (const auto& l = form.local)
    sun.direction = engine::sun_direction(local_axes(l->lat_deg, l->lon_deg), l->azimuth_deg, l->elevation_deg);
  const bool by_epoch = form.utc || form.et_s;
  if (by_epoch) {
    try {
      const engine::SunPosition position = engine::sun_at(form.as_utc());
      sun.direction = position.direction;
      sun.distance_au = position.distance_au;
    } catch (const ImpossibleRequest& e) {
      in.fail(form.member(), e.what());
      return std::nullopt;
    }
  }
  sun.distance_au = form.distance_au.value_or(sun.distance_au);
  // Compute the disc's size from the distance if the client wrote "sun", or if an epoch but no size is given.
  if (form.angular_radius_deg ? !form.angular_radius_deg->has_value() : by_epoch) {
    sun.angular_radius_deg = engine::sun_radius_deg(sun.distance_au);
    if (sun.angular_radius_deg > kAngularRadius_deg.max) {
      in.fail("angular_radius_deg", fmt::format("is {:.3g} degrees at {} au: at most {}", sun.angular_radius_deg,
                                                sun.distance_au, kAngularRadius_deg.max));
      return std::nullopt;
    }
  } else if (form.angular_radius_deg) {
    sun.angular_radius_deg = **form.angular_radius_deg;
  }
  sun.limb_darkening = form.limb_darkening;
  return sun;
}

SunForm form_of(const Sun& sun) {
  SunForm form;
  form.direction = sun.direction;
  form.distance_au = sun.distance_au;
  form.angular_radius_deg = sun.angular_radius_deg;
  form.limb_darkening = sun.limb_darkening;
  return form;
}

}  // namespace

std::string utc_of(const Json& object) {
  if (!object.is_object()) return {};
  if (object.contains("utc") && object["utc"].is_string()) return object["utc"].get<std::string>();
  if (!object.contains("et_s") || !object["et_s"].is_number()) return {};
  try {
    return engine::utc_of_et(object["et_s"].get<double>());
  } catch (const ImpossibleRequest&) {
    return {};  // the object's own table reports it
  }
}

std::string utc_of_sun(const Json& body) {
  return body.is_object() && body.contains("sun") ? utc_of(body["sun"]) : std::string();
}

const Members<SunForm, Sun>& sun_members() {
  static const auto table = make_table<Members<SunForm, Sun>>(
      "Sun", "Exactly one of direction, subsolar, local, utc, et_s is required. Always MOON_ME.", [](auto& m) {
        m.add("direction", &SunForm::direction, Vector{kAnyNumber}, "toward the Sun; any length but zero");
        m.add("subsolar", &SunForm::subsolar, Object{place_members()}, "the sub-solar point");
        m.add("local", &SunForm::local, Object{local_members()}, "azimuth and elevation at a place");
        m.add("utc", &SunForm::utc, Text{},
              "epoch, ISO 8601, e.g. 2026-11-20T00:00:00Z or, by day of the year, 2026-324T00:00:00Z");
        m.add("et_s", &SunForm::et_s, Number{kAnyNumber, "s"}, std::string(kEtMeaning));
        m.add("distance_au", &SunForm::distance_au, Number{kDistance_au, "au"},
              "scales irradiance by 1/r^2; default: 1, with an epoch from the ephemeris");
        m.add("angular_radius_deg", &SunForm::angular_radius_deg, NumberOr{kAngularRadius_deg, "sun", "deg"},
              "angular radius of the solar disc; 0: a point Sun with hard shadows; \"sun\": the true radius at "
              "distance_au; default: 0, with an epoch \"sun\"");
        m.add("limb_darkening", &SunForm::limb_darkening, Number{kUnitInterval},
              "limb-darkening coefficient u, 1 - u (1 - cos), cos: of the emission angle at the Sun; about 0.6 in the "
              "visible; default: 0 for the light of the ground, 0.6 where `sky` shows the Sun");
        m.exactly_one({"direction", "subsolar", "local", "utc", "et_s"});
        m.resolve(resolve_sun);
        m.unresolve([](const Sun& sun) { return form_of(sun); });
      });
  return *table;
}

}  // namespace selenograph::api
