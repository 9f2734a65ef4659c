#include "api/points_json.h"

#include <charconv>
#include <cmath>

#include "api/ranges.h"

namespace selenograph::api {
namespace {

using OrderedJson = nlohmann::ordered_json;

OrderedJson vector_json(const Vec3& v) { return OrderedJson::array({v.x(), v.y(), v.z()}); }

OrderedJson number_json(double x) { return std::isfinite(x) ? OrderedJson(x) : OrderedJson(nullptr); }

std::size_t most(const Limits& limits) { return static_cast<std::size_t>(limits.max_rays); }

std::optional<engine::Sun> read_optional_sun(const JsonReader& in) {
  return in.has("sun") ? std::optional(read_sun(in.at("sun"))) : std::nullopt;
}

engine::Ray read_ray(const JsonReader& in) {
  engine::Ray ray{Vec3::Zero(), Vec3::UnitX()};
  if (!in.object({"origin_m", "direction"})) return ray;
  if (in.has("origin_m")) ray.origin_m = in.at("origin_m").vector(kCoordinate_m);
  if (in.has("direction")) {
    const std::optional<Vec3> direction = direction_of(in.at("direction").vector(kAnyNumber));
    if (!direction) in.fail("direction", "is no direction: three numbers, not all zero");
    ray.direction = direction.value_or(Vec3::UnitX());
  }
  for (const std::string_view name : {"origin_m", "direction"}) {
    if (!in.has(name)) in.fail(name, "is required");
  }
  return ray;
}

engine::LandmarkQuery read_landmark(const JsonReader& in) {
  engine::LandmarkQuery query;
  if (!in.object({"lat_deg", "lon_deg", "height_m"})) return query;
  query.lat_deg = in.number("lat_deg", kLatitude_deg);
  query.lon_deg = in.number("lon_deg", kLongitude_deg);
  if (in.has("height_m")) query.height_m = in.number("height_m", kHeight_m);
  return query;
}

// A list of this name, which must be there and not be empty.
template <typename Each>
void read_list(const JsonReader& in, std::string_view name, const Limits& limits, Each&& each) {
  if (in.has(name)) {
    in.at(name).elements(1, most(limits), each);
  } else {
    in.fail(name, "is required");
  }
}

// A query string's text as the JSON value it stands for: a number where it reads as one.
Json number_or_text(const std::string& text) {
  double x = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), x);
  return error == std::errc() && end == text.data() + text.size() ? Json(x) : Json(text);
}

const char* why_no_height(double lat_deg, double lon_deg, const dem::Catalogue& catalogue) {
  return catalogue.touching(lat_deg, lat_deg, lon_deg, lon_deg).empty() ? "no dataset covers this place"
                                                                        : "the datasets here have no valid post";
}

}  // namespace

RaysQuery read_rays(const Json& body, const Limits& limits) {
  Findings findings;
  const JsonReader in(body, findings);
  RaysQuery query;
  if (in.object({"rays", "sun"})) {
    read_list(in, "rays", limits, [&](const JsonReader& ray) { query.rays.push_back(read_ray(ray)); });
    query.sun = read_optional_sun(in);
  }
  findings.throw_if_any();
  return query;
}

ProjectQuery read_project(const Json& body, const Limits& limits) {
  Findings findings;
  const JsonReader in(body, findings);
  ProjectQuery query;
  if (in.object({"camera", "pose", "sun", "points"})) {
    for (const std::string_view name : {"camera", "pose"}) {
      if (!in.has(name)) in.fail(name, "is required");
    }
    if (in.has("camera")) query.camera = read_camera(in.at("camera"), limits);
    if (in.has("pose")) query.pose = read_pose(in.at("pose"));
    query.sun = read_optional_sun(in);
    read_list(in, "points", limits, [&](const JsonReader& point) { query.points.push_back(read_landmark(point)); });
  }
  findings.throw_if_any();
  return query;
}

std::vector<Geographic> read_heights(const Json& body, const Limits& limits) {
  Findings findings;
  const JsonReader in(body, findings);
  std::vector<Geographic> places;
  if (in.object({"points"})) {
    read_list(in, "points", limits, [&](const JsonReader& point) { places.push_back(read_place(point, false)); });
  }
  findings.throw_if_any();
  return places;
}

Geographic read_height_query(const std::multimap<std::string, std::string>& query) {
  Findings findings;
  Json object = Json::object();
  for (const auto& [name, text] : query) {
    if (query.count(name) > 1) throw RequestError("invalid_request", "a query parameter is given twice");
    object[name] = number_or_text(text);
  }
  const Geographic place = read_place(JsonReader(object, findings), false);
  findings.throw_if_any();
  return place;
}

OrderedJson rays_json(std::span<const engine::RayHit> hits, bool sun_given) {
  OrderedJson list = OrderedJson::array();
  for (const engine::RayHit& hit : hits) {
    OrderedJson ray{{"hit", hit.hit}};
    if (hit.hit) {
      ray["range_m"] = number_json(hit.range_m);
      ray["position_m"] = vector_json(hit.position_m);
      ray["normal"] = vector_json(hit.normal);
      if (sun_given) ray["lit"] = number_json(hit.lit);
    }
    list.push_back(std::move(ray));
  }
  return {{"rays", std::move(list)}};
}

OrderedJson landmarks_json(std::span<const engine::Landmark> landmarks, bool sun_given, const dem::Catalogue& catalogue,
                           std::span<const engine::LandmarkQuery> points) {
  OrderedJson list = OrderedJson::array();
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    const engine::Landmark& landmark = landmarks[i];
    OrderedJson point{{"x_px", number_json(landmark.x_px)},
                      {"y_px", number_json(landmark.y_px)},
                      {"range_m", number_json(landmark.range_m)},
                      {"height_m", number_json(landmark.height_m)},
                      {"in_frame", landmark.in_frame},
                      {"visible", landmark.visible}};
    if (sun_given) point["lit"] = number_json(landmark.lit);
    if (!std::isfinite(landmark.height_m)) {
      point["reason"] = why_no_height(points[i].lat_deg, points[i].lon_deg, catalogue);
    } else if (!std::isfinite(landmark.x_px)) {
      point["reason"] = "behind the camera";
    }
    list.push_back(std::move(point));
  }
  return {{"points", std::move(list)}};
}

OrderedJson height_json(const dem::HeightAnswer& answer, const dem::Catalogue& catalogue) {
  OrderedJson json{{"lat_deg", answer.lat_deg}, {"lon_deg", wrap_lon_deg(answer.lon_deg)}};
  if (!std::isfinite(answer.height_m) || answer.source < 0) {
    json["height_m"] = nullptr;
    json["reason"] = why_no_height(answer.lat_deg, answer.lon_deg, catalogue);
    return json;
  }
  json["height_m"] = answer.height_m;
  json["post_spacing_m"] = number_json(answer.post_spacing_m);
  json["source"] = catalogue.rasters().at(static_cast<std::size_t>(answer.source)).name;
  json["filled"] = answer.filled;
  return json;
}

}  // namespace selenograph::api
