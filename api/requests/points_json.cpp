// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/points_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <utility>

#include "api/json/ranges.h"
#include "api/requests/features_json.h"
#include "api/requests/parts/array_rows.h"
#include "api/requests/parts/band_json.h"
#include "api/requests/parts/pose_json.h"
#include "api/requests/parts/shutter_json.h"
#include "api/schema/member_kinds.h"

namespace selenograph::api {
namespace {

std::int64_t max_rays(const Limits& limits) { return limits.max_rays; }

const Members<engine::Ray>& ray_members() {
  using engine::Ray;
  static const auto table = make_table<Members<Ray>>("Ray", "A ray from a point.", [](auto& m) {
    m.add("origin_m", &Ray::origin_m, Vector{kCoordinate_m, "m"}, "MOON_ME").required();
    m.add("direction", &Ray::direction, Vector{kAnyNumber}, "MOON_ME; any length but zero").required();
    m.resolve([](const JsonReader& in, const Ray& ray, const ReadContext&) -> std::optional<Ray> {
      const std::optional<Vec3> direction = direction_of(ray.direction);
      if (direction) return Ray{ray.origin_m, *direction};
      in.fail("direction", "is not a direction: three numbers are required, not all zero");
      return std::nullopt;
    });
  });
  return *table;
}

const Members<engine::LandmarkQuery>& landmark_members() {
  using engine::LandmarkQuery;
  static const auto table =
      make_table<Members<LandmarkQuery>>("Landmark", "A point, on the terrain or at a height.", [](auto& m) {
        add_latitude_and_longitude(m);
        m.add("height_m", &LandmarkQuery::height_m, Number{kHeight_m, "m"},
              "height above the sphere of 1 737 400 m; left out: on the terrain");
      });
  return *table;
}

// Adds the rows of PointScenery. Without "sun" answers have no `lit`; without "indirect" they have no `irradiance`, and
// only that depends on ground and band.
template <typename Query>
void add_point_scenery(Members<Query>& m, const char* of_objects) {
  add_scenery(m);
  m.add("band", nested(&Query::request, &engine::FrameRequest::band), Object{band_members()},
        "spectral channel of the irradiance; left out: all wavelengths");
  m.add("objects", &Query::objects, List{Object{object_members()}, 1, kMaxObjects}, of_objects);
  m.needs("indirect", {"sun"}, "whose light it is");
}

// Returns a query parameter as a JSON value: a number if the whole text is one, else the text.
Json number_or_text(const std::string& text) {
  double x = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), x);
  return error == std::errc() && end == text.data() + text.size() ? Json(x) : Json(text);
}

}  // namespace

const Members<RaysQuery>& rays_members() {
  static const auto table =
      make_table<Members<RaysQuery>>("RaysRequest", "Rays against the finest terrain and objects.", [](auto& m) {
        m.add("rays", &RaysQuery::rays, List{Object{ray_members()}, 1, max_rays}, "the rays").required();
        add_point_scenery(m, "as in a frame: rays hit them, and they cast shadows");
        add_map_error(m);
        m.add(
            "min_post_spacing_m", &RaysQuery::min_post_spacing_m, Number{{0, 1e4}, "m"},
            "of ground with `detail`: closer posts, and smaller rocks, are left out, as a beam of this width would; 0: "
            "none. Ground to the millimetre takes 40 ms per place that is far from others, once");
        m.check([](const JsonReader&, RaysQuery& query, const ReadContext& context) {
          query.sun_utc = context.sun_utc;
          resolve_preset(query.request, query.surface);
        });
      });
  return *table;
}

const Members<ProjectQuery>& project_members() {
  static const auto table = make_table<
      Members<ProjectQuery>>("ProjectRequest", "Landmarks to project, for a camera and a pose.", [](auto& m) {
    m.add("camera", &ProjectQuery::camera, Object{camera_members()}, "projection and image size").required();
    m.add("pose", &ProjectQuery::pose, Object{pose_members()},
          "position and attitude of the camera; required unless `shutter.poses` is given");
    m.add("shutter", &ProjectQuery::shutter, Object{shutter_members()},
          "times of the rows: the answer has a `time_s`; left out: all rows are exposed at once");
    add_point_scenery(m, "as in a frame: they hide landmarks, and they cast shadows");
    m.add("points", &ProjectQuery::points, List{Object{landmark_members()}, 1, max_rays}, "the landmarks").required();
    m.check([](const JsonReader& in, ProjectQuery& query, const ReadContext& context) {
      query.sun_utc = context.sun_utc;
      check_pose(in, query.camera, query.shutter, query.pose);
      resolve_preset(query.request, query.surface);
    });
    m.add_condition(pose_condition);
  });
  return *table;
}

const Members<HeightsQuery>& heights_members() {
  static const auto table = make_table<Members<HeightsQuery>>("HeightsRequest", "Points on the terrain.", [](auto& m) {
    m.add("points", &HeightsQuery::points, List{Object{place_members()}, 1, max_rays}, "the places").required();
    m.add("detail", &HeightsQuery::detail, DetailName{}, kDetailMeaning);
    add_map_error(m);
  });
  return *table;
}

namespace {

// Returns the request with one valid element in the list that arrays replace, so that the other members can be checked.
Json with_stand_in(const Json& body, const char* list, const char* array, Json element, Findings& findings) {
  Json request = body;
  if (!request.is_object()) return request;
  if (request.contains(list)) findings.add(std::string("/") + list, std::string("cannot be combined with ") + array);
  request[list] = Json::array({std::move(element)});
  return request;
}

// Returns true if an array has no more rows than the service takes; reports it at `pointer` otherwise.
bool fits_limit(std::size_t row_count, const Limits& limits, const char* pointer, Findings& findings) {
  if (row_count <= static_cast<std::size_t>(limits.max_rays)) return true;
  findings.add(pointer, fmt::format("has {} rows; up to {} are taken (--max-rays)", row_count, limits.max_rays));
  return false;
}

// Returns all dimensions but the last.
std::vector<std::size_t> shape_of_rows(const NpzArray& array) { return {array.shape.begin(), array.shape.end() - 1}; }

// Replaces the query's rays by those in the arrays; a single origin or direction is used with all rows of the other.
void set_rays(const NpzArrays& arrays, const Limits& limits, RaysQuery& query, Findings& findings) {
  const auto origins = rows_of(arrays, "origin_m", {3}, findings),
             directions = rows_of(arrays, "direction", {3}, findings);
  if (!origins || !directions) return;
  const std::size_t ray_count = std::max(origins->size(), directions->size());
  if (std::min(origins->size(), directions->size()) != 1 && origins->size() != directions->size())
    return findings.add("/direction", fmt::format("has {} rows and origin_m {}: as many, or one, are needed",
                                                  directions->size(), origins->size()));
  if (!fits_limit(ray_count, limits, "/direction", findings)) return;
  query.shape = shape_of_rows(arrays.at(directions->size() == ray_count ? "direction" : "origin_m"));
  query.rays.clear();
  for (std::size_t i = 0; i < ray_count && !findings.full(); ++i) {
    const Vec3 origin = origins->vector(i);
    const auto direction = direction_of(directions->vector(i));
    if (!origin.is_within(kCoordinate_m.max))
      findings.add(fmt::format("/origin_m/{}", i), fmt::format("is not within {:g} m", kCoordinate_m.max));
    if (!direction) findings.add(fmt::format("/direction/{}", i), "is not a direction: finite numbers, not all zero");
    query.rays.push_back({origin, direction.value_or(Vec3::unit_x())});
  }
}

// Replaces the query's landmarks by the rows of the array "points".
void set_points(const NpzArrays& arrays, const Limits& limits, ProjectQuery& query, Findings& findings) {
  const auto points = rows_of(arrays, "points", {2, 3}, findings);
  if (!points || !fits_limit(points->size(), limits, "/points", findings)) return;
  query.shape = shape_of_rows(arrays.at("points"));
  query.points.clear();
  for (std::size_t i = 0; i < points->size() && !findings.full(); ++i) {
    const double* lat_lon_height = points->row(i);
    const auto check = [&](double value, const Range& range, const char* what) {
      if (!range.contains(value))
        findings.add(fmt::format("/points/{}", i),
                     fmt::format("has the {} {}; {:g} to {:g} is needed", what, value, range.min, range.max));
    };
    check(lat_lon_height[0], kLatitude_deg, "latitude");
    check(lat_lon_height[1], kLongitude_deg, "longitude");
    engine::LandmarkQuery landmark{lat_lon_height[0], lat_lon_height[1], {}};
    if (points->columns() == 3 && !std::isnan(lat_lon_height[2])) {
      check(lat_lon_height[2], kHeight_m, "height");
      landmark.height_m = lat_lon_height[2];
    }
    query.points.push_back(landmark);
  }
}

}  // namespace

RaysQuery read_rays(const Json& body, const Limits& limits, const Assets& assets, const StopToken& stop,
                    const NpzArrays& arrays, const GroundHeights& ground) {
  ReadContext context{limits, assets, stop, utc_of_sun(body)};
  context.ground_height = ground_height_of(body, ground, context);
  if (arrays.empty()) return rays_members().read_body(body, context);
  Findings findings;
  reject_unknown_arrays(arrays, {"origin_m", "direction"}, findings);
  // This ray stands in for those of the arrays: any valid one will do.
  const Json request = with_stand_in(body, "rays", "the array direction",
                                     {{"origin_m", {2e6, 0, 0}}, {"direction", {-1, 0, 0}}}, findings);
  findings.throw_if_any();
  RaysQuery query = rays_members().read_body(request, context);
  set_rays(arrays, limits, query, findings);
  findings.throw_if_any();
  return query;
}

ProjectQuery read_project(const Json& body, const Limits& limits, const Assets& assets, const StopToken& stop,
                          const NpzArrays& arrays, const GroundHeights& ground) {
  ReadContext context{limits, assets, stop, utc_of_sun(body)};
  context.ground_height = ground_height_of(body, ground, context);
  if (arrays.empty()) return project_members().read_body(body, context);
  Findings findings;
  reject_unknown_arrays(arrays, {"points"}, findings);
  const Json request = with_stand_in(body, "points", "the array points", {{"lat_deg", 0}, {"lon_deg", 0}}, findings);
  findings.throw_if_any();
  ProjectQuery query = project_members().read_body(request, context);
  set_points(arrays, limits, query, findings);
  findings.throw_if_any();
  return query;
}

HeightsQuery read_heights(const Json& body, const Limits& limits, const Assets& assets, const StopToken& stop) {
  return heights_members().read_body(body, {limits, assets, stop});
}

Geographic read_height_query(const std::multimap<std::string, std::string>& query) {
  Json object = Json::object();
  for (const auto& [name, text] : query) {
    if (query.count(name) > 1)
      throw RequestError("invalid_request", "a query parameter is given twice", {{"/" + name, "given twice"}});
    object[name] = number_or_text(text);
  }
  return place_members().read_body(object, {Limits{}, Assets{}});
}

}  // namespace selenograph::api
