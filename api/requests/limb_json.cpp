// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
//
// Tables of an answer's members (api/schema/answers.h). A row is a.add(name in JSON, JSON Schema, function that returns
// the value, condition); a member without a condition is always written.
#include "api/requests/limb_json.h"

#include <cmath>
#include <utility>

#include "api/encode/columns.h"
#include "api/requests/parts/camera_json.h"
#include "api/requests/parts/pose_json.h"
#include "api/requests/parts/sun_json.h"
#include "api/schema/member_kinds.h"

namespace selenograph::api {
namespace {

using engine::LimbPoint;
using engine::LimbRequest;
using engine::TerminatorPoint;

constexpr int kMinPoints = 3, kMaxPoints = 10000;

// Returns the distance in the image from the sphere's limb to the terrain's, px, positive outward.
double difference_px(const LimbPoint& p) {
  return std::copysign(std::hypot(p.x_px - p.sphere_x_px, p.y_px - p.sphere_y_px), p.angle_deg - p.sphere_angle_deg);
}

// Returns the surface point's place; LimbPoint::kNone (NaN) without data.
template <typename Point>
Geographic place_of(const Point& p) {
  return p.known() ? to_geographic(p.position_m) : Geographic{LimbPoint::kNone, LimbPoint::kNone, LimbPoint::kNone};
}
template <typename Point>
double longitude_deg(const Point& p) {
  return p.known() ? wrap_lon_deg(place_of(p).lon_deg) : LimbPoint::kNone;
}

// A number of the answer: a member in JSON, an array in NPZ.
template <typename Point>
struct Column {
  const char* name;
  const char* meaning;
  double (*value)(const Point&);
};
constexpr Column<LimbPoint> kLimbColumns[] = {
    {"azimuth_deg",
     "around the direction to the Moon's centre, from +x toward +y of camera axes that are turned by the shortest way "
     "so that +z points at the centre: in an image with the centre in its middle, from right to down",
     [](const LimbPoint& p) { return p.azimuth_deg; }},
    {"angle_deg", "from the Moon's centre to the terrain's limb, at the camera",
     [](const LimbPoint& p) { return p.angle_deg; }},
    {"x_px", "column of the terrain's limb; null where it is not imaged", [](const LimbPoint& p) { return p.x_px; }},
    {"y_px", "row of the terrain's limb; null if x_px is null", [](const LimbPoint& p) { return p.y_px; }},
    {"range_m", "from the camera to the surface point, m", [](const LimbPoint& p) { return p.range_m; }},
    {"lat_deg", "planetocentric latitude of the surface point", [](const LimbPoint& p) { return place_of(p).lat_deg; }},
    {"lon_deg", "east longitude of the surface point, in [-180, 180)", longitude_deg<LimbPoint>},
    {"height_m", "height of the surface point above the sphere of 1 737 400 m",
     [](const LimbPoint& p) { return p.position_m.norm() - kMoonRadius_m; }},
    {"sphere_angle_deg", "as angle_deg, of the sphere of 1 737 400 m; null for a camera below it",
     [](const LimbPoint& p) { return p.sphere_angle_deg; }},
    {"sphere_x_px", "column of the sphere's limb", [](const LimbPoint& p) { return p.sphere_x_px; }},
    {"sphere_y_px", "row of the sphere's limb", [](const LimbPoint& p) { return p.sphere_y_px; }},
    {"difference_px", "distance in the image from the sphere's limb to the terrain's, positive outward", difference_px},
};

constexpr Column<TerminatorPoint> kTerminatorColumns[] = {
    {"azimuth_deg", "around the direction to the Sun, from the Moon's north pole through the east of what the Sun sees",
     [](const TerminatorPoint& p) { return p.azimuth_deg; }},
    {"x_px", "column of the terrain's terminator; null where there is no data or it is not imaged",
     [](const TerminatorPoint& p) { return p.x_px; }},
    {"y_px", "row of the terrain's terminator; null if x_px is null", [](const TerminatorPoint& p) { return p.y_px; }},
    {"lat_deg", "planetocentric latitude of the surface point",
     [](const TerminatorPoint& p) { return place_of(p).lat_deg; }},
    {"lon_deg", "east longitude of the surface point, in [-180, 180)", longitude_deg<TerminatorPoint>},
    {"height_m", "height of the surface point above the sphere of 1 737 400 m",
     [](const TerminatorPoint& p) { return p.position_m.norm() - kMoonRadius_m; }},
    {"sphere_x_px", "column of the terminator of the sphere of 1 737 400 m",
     [](const TerminatorPoint& p) { return p.sphere_x_px; }},
    {"sphere_y_px", "row of the terminator of the sphere of 1 737 400 m",
     [](const TerminatorPoint& p) { return p.sphere_y_px; }},
};

// Returns the member "reason" of a point without a place in the image.
const char* why_no_point(const LimbPoint& p) {
  if (!p.known()) return "no data where the line of sight passes lower than the highest terrain";
  return "behind the camera or beyond the lens's field of view";
}

}  // namespace

const Members<LimbQuery>& limb_request_members() {
  static const auto table = make_table<Members<LimbQuery>>(
      "LimbRequest", "The Moon's limb and terminator in a camera's image, from its pose.", [](auto& m) {
        m.add("camera", nested(&LimbQuery::request, &LimbRequest::camera), Object{camera_members()},
              "projection and image size")
            .required();
        m.add("pose", nested(&LimbQuery::request, &LimbRequest::pose), Object{pose_members()},
              "position and attitude of the camera")
            .required();
        m.add("points", nested(&LimbQuery::request, &LimbRequest::points), Integer{kMinPoints, kMaxPoints},
              "number of azimuths, from 0 in equal steps, of the limb and of the terminator");
        m.add("sun", nested(&LimbQuery::request, &LimbRequest::sun), Object{sun_members()},
              "Sun of the terminator, as a point; left out: none");
        m.add("detail", &LimbQuery::detail, DetailName{}, kDetailMeaning);
      });
  return *table;
}

LimbQuery read_limb(const Json& body, const Limits& limits, const Assets& assets, const StopToken& stop,
                    const GroundHeights& ground) {
  ReadContext context{limits, assets, stop, utc_of_sun(body)};
  context.ground_height = ground_height_of(body, ground, context);
  return limb_request_members().read_body(body, context);
}

// In a row with four arguments, the last one tells when the member is written.
const Answer<LimbPoint>& limb_answer() {
  using namespace schema;
  static const auto answer = make_answer<LimbPoint>("The limb at an azimuth.", [](auto& a) {
    for (const auto& column : kLimbColumns) a.add(column.name, number_or_null(column.meaning), column.value);
    a.add(
        "position_m", vector("surface point of the terrain's limb, MOON_ME, m; left out without data"),
        [](const LimbPoint& p) { return p.position_m; }, [](const LimbPoint& p) { return p.known(); });
    a.add("in_frame", boolean("the terrain's limb is within the image"), [](const LimbPoint& p) { return p.in_frame; });
    a.add("reason", text("why x_px is null: no data; behind the camera or beyond the lens's field of view"),
          why_no_point, [](const LimbPoint& p) { return std::isnan(p.x_px); });
  });
  return answer;
}

const Answer<TerminatorPoint>& terminator_answer() {
  using namespace schema;
  static const auto answer = make_answer<TerminatorPoint>("The terminator at an azimuth.", [](auto& a) {
    for (const auto& column : kTerminatorColumns) a.add(column.name, number_or_null(column.meaning), column.value);
    a.add(
        "position_m", vector("surface point of the terrain's terminator, MOON_ME, m; left out without data"),
        [](const TerminatorPoint& p) { return p.position_m; }, [](const TerminatorPoint& p) { return p.known(); });
    a.add("in_frame", boolean("the terrain's terminator is within the image"),
          [](const TerminatorPoint& p) { return p.in_frame; });
    a.add("visible", boolean("in_frame, and no terrain hides the point from the camera"),
          [](const TerminatorPoint& p) { return p.visible; });
    a.add("sphere_visible", boolean("the sphere's terminator is within the image and on the camera's side"),
          [](const TerminatorPoint& p) { return p.sphere_visible; });
  });
  return answer;
}

OrderedJson limb_json(const LimbPoints& limb) {
  OrderedJson json{{"points", limb_answer().write_all(limb.points)}};
  if (!limb.terminator.empty()) json["terminator"] = terminator_answer().write_all(limb.terminator);
  return json;
}

namespace {

// Adds an array for each column and one for the surface points; their names begin with `prefix`.
template <typename Point, std::size_t N>
void add_columns(ColumnArrays& arrays, const std::string& prefix, const std::vector<Point>& points,
                 const Column<Point> (&columns)[N]) {
  for (const Column<Point>& column : columns) arrays.add(prefix + column.name, points, column.value);
  arrays.add(prefix + "position_m", points, &Point::position_m);
}

}  // namespace

std::string limb_npz(const LimbPoints& limb, const StopToken& stop) {
  ColumnArrays arrays({}, ElementType::uint8, stop);
  add_columns(arrays, "", limb.points, kLimbColumns);
  arrays.add("in_frame", limb.points, &LimbPoint::in_frame);
  if (!limb.terminator.empty()) {
    add_columns(arrays, "terminator_", limb.terminator, kTerminatorColumns);
    arrays.add("terminator_in_frame", limb.terminator, &TerminatorPoint::in_frame);
    arrays.add("terminator_visible", limb.terminator, &TerminatorPoint::visible);
    arrays.add("terminator_sphere_visible", limb.terminator, &TerminatorPoint::sphere_visible);
  }
  return arrays.npz("{}");
}

}  // namespace selenograph::api
