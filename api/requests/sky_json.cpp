// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
//
// Tables of an answer's members (api/schema/answers.h). A row is a.add(name in JSON, JSON Schema, function that returns
// the value, condition); a member without a condition is always written.
#include "api/requests/sky_json.h"

#include <cmath>
#include <limits>

#include "api/encode/columns.h"
#include "api/message/json_text.h"
#include "api/requests/parts/band_json.h"
#include "api/requests/parts/camera_json.h"
#include "api/requests/parts/camera_preset.h"
#include "api/requests/parts/sensor_json.h"
#include "api/requests/parts/shutter_json.h"
#include "api/requests/parts/sky_options_json.h"
#include "api/requests/parts/sun_json.h"
#include "api/schema/member_kinds.h"
#include "dem/base/error.h"
#include "engine/frame/sun.h"
#include "engine/radiometry/earth.h"

namespace selenograph::api {
namespace {

using engine::FrameRequest;
using engine::HiddenBy;
using engine::SkyKind;
using engine::SkyObject;

constexpr std::pair<std::string_view, SkyKind> kSkyKinds[] = {
    {"star", SkyKind::star}, {"sun", SkyKind::sun}, {"earth", SkyKind::earth}, {"planet", SkyKind::planet}};
constexpr std::pair<std::string_view, HiddenBy> kHiddenBy[] = {
    {"none", HiddenBy::none}, {"moon", HiddenBy::moon}, {"object", HiddenBy::object}, {"earth", HiddenBy::earth}};

constexpr double kNotANumber = std::numeric_limits<double>::quiet_NaN();

// Returns the magnitude rounded to 1e-4: the catalogue's decimal digits, without those that float adds.
double magnitude_of(const SkyObject& object) { return std::round(object.v_mag * 1e4) / 1e4; }

bool visible(const SkyObject& object) { return object.in_frame && object.hidden_by == HiddenBy::none; }

// Returns the angular radius of the Sun or the Earth; empty for points.
std::optional<double> angular_radius_deg(const SkyObject& object) {
  if (object.kind == SkyKind::sun) return engine::sun_radius_deg(*object.distance_m / engine::kAstronomicalUnit_m);
  return object.kind == SkyKind::earth ? std::optional(engine::earth_radius_deg(*object.distance_m)) : std::nullopt;
}

// Returns the direction to the object in the axes of the camera's pose.
Vec3 in_camera(const SkySource& s) { return s.query.request.pose.camera_from_moon * s.object.direction; }

// "objects": stored in the engine's request only, and never written.
const auto objects_of_sky = Property{[](const SkyQuery&) { return std::optional<std::vector<PlacedObject>>(); },
                                     [](SkyQuery& q, const std::vector<PlacedObject>& list) {
                                       for (const PlacedObject& placed : list)
                                         q.request.objects.push_back(placed.object);
                                     }};

// Checks rules between members and completes the query.
void check_sky(const JsonReader& in, SkyQuery& query, const ReadContext& context) {
  engine::FrameRequest& request = query.request;
  request.detail = query.detail.content;
  check_pose(in, request.camera, request.shutter, request.pose);
  try {
    if (query.utc || query.et_s) engine::tt_at(query.as_utc());
  } catch (const ImpossibleRequest& e) {
    in.fail(query.member(), e.what());
  }
  if (in.faults() == 0)
    query.icrf_lag_s = icrf_lag_s(in, request.camera, request.shutter, context.sun_utc, request.sky->utc);
  if (!request.sensor) return;
  check_sensor(in, request);
  if (request.sensor->exposure.target_fill > 0)
    in.at("sensor").fail("exposure", "chooses a time from the whole image: give \"detector.integration_time_s\" here");
}

}  // namespace

const Members<SkyQuery>& sky_request_members() {
  static const auto table = make_table<Members<SkyQuery>>(
      "SkyRequest", "The sky that a camera sees, from its pose and an epoch.", [](auto& m) {
        add_camera_and_pose(m);
        m.add("shutter", nested(&SkyQuery::request, &FrameRequest::shutter), Object{shutter_members()},
              "row times: each object is placed by the row that sees it. All rows have the sky of the epoch; left out: "
              "all rows are exposed at once");
        m.add("utc", &SkyQuery::utc, Text{}, "epoch, ISO 8601");
        m.add("et_s", &SkyQuery::et_s, Number{kAnyNumber, "s"}, std::string(kEtMeaning));
        m.add("sky", nested(&SkyQuery::request, &FrameRequest::sky), Object{sky_members()},
              "what is listed, as in a frame")
            .required();
        m.add("band", nested(&SkyQuery::request, &FrameRequest::band), Object{band_members()},
              "spectral channel of irradiance_w_m2; left out: all wavelengths");
        m.add("sensor", nested(&SkyQuery::request, &FrameRequest::sensor), Object{sensor_members()},
              "for `electrons`; left out: none in the answer");
        m.add("camera_preset", no_field<SkyQuery, std::string>(), Text{}, kCameraPresetMeaning);
        m.add("detail", &SkyQuery::detail, DetailName{}, kDetailMeaning);
        m.add("objects", objects_of_sky, List{Object{object_members()}, 1, kMaxObjects},
              "as in a frame: they hide objects behind them");
        m.exactly_one({"utc", "et_s"});
        m.any_of({"camera", "camera_preset"});
        m.needs("sensor", {"band", "camera_preset"}, "which photons it counts");
        m.check(check_sky);
        m.add_condition(pose_condition);
      });
  return *table;
}

SkyQuery read_sky(const Json& body, const Limits& limits, const Assets& assets, const StopToken& stop,
                  const GroundHeights& ground) {
  ReadContext context{limits, assets, stop, utc_of(body)};
  if (const auto merged = with_camera_preset(body, context)) return read_sky(*merged, limits, assets, stop, ground);
  context.ground_height = ground_height_of(body, ground, context);
  return sky_request_members().read_body(body, context);
}

const Answer<SkySource>& sky_answer() {
  using S = SkySource;
  using namespace schema;
  static const auto answer = make_answer<S>("Something in the sky.", [](auto& a) {
    a.add("kind", words(kSkyKinds, "kind of object"), [](const S& s) { return word_of(kSkyKinds, s.object.kind); });
    a.add("id", text("identifier of a star in its catalogue, or the name of another object, like jupiter"),
          [](const S& s) { return s.object.id; });
    a.add("x_px",
          number_or_null(
              "column; null behind the camera, beyond the lens's field of view and, with a shutter, where no row "
              "sees it"),
          [](const S& s) { return s.object.x_px; });
    a.add("y_px", number_or_null("row; null if x_px is null"), [](const S& s) { return s.object.y_px; });
    a.add("in_frame", boolean("the object's centre is within the image"), [](const S& s) { return s.object.in_frame; });
    a.add("visible", boolean("in_frame, and nothing hides the object"), [](const S& s) { return visible(s.object); });
    a.add("hidden_by",
          words(kHiddenBy, "what a ray to the object's centre meets, if the object has a position in the image plane"),
          [](const S& s) { return word_of(kHiddenBy, s.object.hidden_by); });
    a.add("direction_icrf", schema::vector("apparent direction to the object, unit vector, ICRF axes"),
          [](const S& s) { return s.object.direction_icrf; });
    a.add("direction", schema::vector("apparent direction to the object, unit vector, MOON_ME axes"),
          [](const S& s) { return s.object.direction; });
    a.add("direction_camera",
          schema::vector("apparent direction to the object, unit vector, camera axes: +x right, +y down, +z boresight"),
          in_camera);
    a.add("magnitude", number(kAnyNumber, "apparent V magnitude"), [](const S& s) { return magnitude_of(s.object); });
    a.add("irradiance_w_m2", number(kAnyNumber, "at normal incidence, in the request's band, W m-2"),
          [](const S& s) { return s.object.irradiance_w_m2; });
    a.add(
        "electrons",
        number_or_null("expected of its whole image, unhidden and without noise, when a sensor was given; null outside "
                       "of the frame"),
        [](const S& s) { return s.object.electrons; }, [](const S& s) { return s.query.request.sensor.has_value(); });
    const auto near = [](const S& s) { return s.object.distance_m.has_value(); };
    a.add(
        "distance_m", number(kAnyNumber, "of the Sun, the Earth and planets: from the camera, when the light left, m"),
        [](const S& s) { return s.object.distance_m; }, near);
    a.add(
        "phase_deg", number({0, 180, false, false}, "of the Earth and planets: there, between Sun and camera"),
        [](const S& s) { return s.object.phase_deg; }, [](const S& s) { return s.object.phase_deg.has_value(); });
    a.add(
        "angular_radius_deg", number({0, 90, false, false}, "of the Sun and the Earth (its equator)"),
        [](const S& s) { return angular_radius_deg(s.object); },
        [](const S& s) { return angular_radius_deg(s.object).has_value(); });
  });
  return answer;
}

OrderedJson sky_json(const std::vector<SkyObject>& sky, const SkyQuery& query) {
  OrderedJson list = OrderedJson::array();
  for (const SkyObject& object : sky) list.push_back(sky_answer().write({object, query}));
  return {{"objects", std::move(list)}};
}

std::string sky_npz(const std::vector<SkyObject>& sky, const SkyQuery& query, const StopToken& stop) {
  ColumnArrays arrays({}, ElementType::uint8, stop);
  arrays.add("x_px", sky, &SkyObject::x_px);
  arrays.add("y_px", sky, &SkyObject::y_px);
  arrays.add("direction_icrf", sky, &SkyObject::direction_icrf);
  arrays.add("direction", sky, &SkyObject::direction);
  arrays.add("direction_camera", sky, [&](const SkyObject& o) { return in_camera({o, query}); });
  arrays.add("magnitude", sky, magnitude_of);
  arrays.add("irradiance_w_m2", sky, &SkyObject::irradiance_w_m2);
  arrays.add("electrons", sky, [](const SkyObject& o) { return o.electrons.value_or(kNotANumber); });
  arrays.add("in_frame", sky, &SkyObject::in_frame);
  arrays.add("visible", sky, visible);
  arrays.add("hidden_by", sky, [](const SkyObject& o) { return static_cast<std::uint8_t>(o.hidden_by); });
  OrderedJson meta{{"kind", OrderedJson::array()}, {"id", OrderedJson::array()}};
  for (const SkyObject& o : sky) {
    meta["kind"].push_back(word_of(kSkyKinds, o.kind));
    meta["id"].push_back(o.id);
  }
  return arrays.npz(json_text(meta));
}

}  // namespace selenograph::api
