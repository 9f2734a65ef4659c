#include "api/requests/limb_json.h"

#include <cmath>

#include "api/encode/encode.h"
#include "api/requests/parts/camera_json.h"
#include "api/requests/parts/pose_json.h"
#include "api/schema/member_kinds.h"

namespace selenograph::api {
namespace {

using engine::LimbPoint;

constexpr int kFewestPoints = 3, kMostPoints = 10000;

// In the image, outward from the sphere's limb.
double difference_px(const LimbPoint& p) {
  return std::copysign(std::hypot(p.x_px - p.sphere_x_px, p.y_px - p.sphere_y_px), p.angle_deg - p.sphere_angle_deg);
}

Geographic place_of(const LimbPoint& p) {
  return p.known() ? to_geographic(p.position_m) : Geographic{LimbPoint::kNone, LimbPoint::kNone, LimbPoint::kNone};
}

// An answer's numbers, by name: the columns of both its forms.
struct LimbColumn {
  const char* name;
  const char* meaning;
  double (*value)(const LimbPoint&);
};
constexpr LimbColumn kLimbColumns[] = {
    {"azimuth_deg",
     "around the direction to the Moon's centre, from +x toward +y of camera axes that are turned by the shortest way "
     "so "
     "that +z points at the centre: in an image with the centre in its middle, from right to down",
     [](const LimbPoint& p) { return p.azimuth_deg; }},
    {"angle_deg", "from the Moon's centre to the terrain's limb, at the camera",
     [](const LimbPoint& p) { return p.angle_deg; }},
    {"x_px", "column of the terrain's limb; null where it is not imaged", [](const LimbPoint& p) { return p.x_px; }},
    {"y_px", "row; null as x_px is", [](const LimbPoint& p) { return p.y_px; }},
    {"range_m", "from the camera to the surface point, m", [](const LimbPoint& p) { return p.range_m; }},
    {"lat_deg", "planetocentric latitude of the surface point", [](const LimbPoint& p) { return place_of(p).lat_deg; }},
    {"lon_deg", "its longitude, in [-180, 180)",
     [](const LimbPoint& p) { return p.known() ? wrap_lon_deg(place_of(p).lon_deg) : LimbPoint::kNone; }},
    {"height_m", "its height above the sphere of 1 737 400 m",
     [](const LimbPoint& p) { return p.position_m.norm() - kMoonRadius_m; }},
    {"sphere_angle_deg", "as angle_deg, of the sphere of 1 737 400 m; null for a camera below it",
     [](const LimbPoint& p) { return p.sphere_angle_deg; }},
    {"sphere_x_px", "column of the sphere's limb", [](const LimbPoint& p) { return p.sphere_x_px; }},
    {"sphere_y_px", "row of the sphere's limb", [](const LimbPoint& p) { return p.sphere_y_px; }},
    {"difference_px", "distance in the image from the sphere's limb to the terrain's, positive outward", difference_px},
};

const char* why_no_point(const LimbPoint& p) {
  if (!p.known()) return "no data where the line of sight passes lower than the highest terrain";
  return "behind the camera or beyond the lens's field of view";
}

}  // namespace

const Members<LimbQuery>& limb_request_members() {
  static const auto table =
      made<Members<LimbQuery>>("LimbRequest", "A camera and its pose: where it sees the Moon's limb.", [](auto& m) {
        m.add(
             "camera", [](auto& q) -> auto& { return q.request.camera; }, Object{camera_members()},
             "projection and image size")
            .required();
        m.add(
             "pose", [](auto& q) -> auto& { return q.request.pose; }, Object{pose_members()},
             "position and attitude of the camera")
            .required();
        m.add(
            "points", [](auto& q) -> auto& { return q.request.points; }, Integer{kFewestPoints, kMostPoints},
            "number of azimuths, from 0 in equal steps");
        m.add("detail", &LimbQuery::detail, DetailName{}, kOfDetail);
      });
  return *table;
}

LimbQuery read_limb(const Json& body, const Limits& limits, const Assets& assets, const StopToken& stop) {
  Findings findings;
  auto query = limb_request_members().read(JsonReader(body, findings), {limits, assets, stop, ""});
  findings.throw_if_any();
  return std::move(*query);
}

const Answer<LimbPoint>& limb_answer() {
  using namespace schema;
  static const auto answer = answer_of<LimbPoint>("The limb at an azimuth.", [](auto& a) {
    for (const LimbColumn& column : kLimbColumns) a.add(column.name, number_or_null(column.meaning), column.value);
    a.add(
        "position_m", vector("surface point of the terrain's limb, MOON_ME, m; left out without data"),
        [](const LimbPoint& p) { return p.position_m; }, [](const LimbPoint& p) { return p.known(); });
    a.add("in_frame", boolean("the terrain's limb is within the image"), [](const LimbPoint& p) { return p.in_frame; });
    a.add("reason", text("why x_px is null: no data; behind the camera or beyond the lens's field of view"),
          why_no_point, [](const LimbPoint& p) { return std::isnan(p.x_px); });
  });
  return answer;
}

OrderedJson limb_json(const std::vector<LimbPoint>& points) { return {{"points", limb_answer().write_all(points)}}; }

std::string limb_npz(const std::vector<LimbPoint>& points, const StopToken& stop) {
  const int size = static_cast<int>(points.size());
  std::vector<std::vector<double>> columns;
  std::vector<ArrayView> arrays;
  for (const LimbColumn& column : kLimbColumns) {
    stop.check();
    auto& values = columns.emplace_back();
    for (const LimbPoint& p : points) values.push_back(column.value(p));
    arrays.push_back({column.name, ElementType::float64, size, 1, 1, values.data(), {}});
  }
  std::vector<double> positions;
  std::vector<std::uint8_t> in_frame;
  for (const LimbPoint& p : points)
    positions.insert(positions.end(), p.position_m.begin(), p.position_m.end()), in_frame.push_back(p.in_frame);
  arrays.push_back({"position_m", ElementType::float64, size, 3, 1, positions.data(), {}});
  arrays.push_back({"in_frame", ElementType::uint8, size, 1, 1, in_frame.data(), {}});
  return encode_npz(arrays, "{}", stop);
}

}  // namespace selenograph::api
