// POST /v1/rays, /v1/project, /v1/heights and GET /v1/height.
#include "api/answers/eclipse.h"
#include "api/answers/metadata.h"
#include "api/answers/points_answer.h"
#include "api/endpoints/routes.h"
#include "dem/base/error.h"
#include "engine/frame/needs.h"
#include "engine/rays/light_at_places.h"
#include "engine/rays/ray_queries.h"

namespace selenograph::api {
namespace {

// Memory of a ray or point: the engine's records, JSON values and text.
constexpr std::size_t kBytesPerPoint = 3000;

// Claims the memory of `points` rays or points; a request with too many of them is at fault at `pointer`.
void claim_memory(const EndpointContext& context, std::size_t points, std::string_view pointer,
                  std::size_t extra_bytes = 0) {
  context.memory.claim_work(kBytesPerPoint * points + extra_bytes, pointer, context.stop);
}

// Returns the memory of the detail's rocks that rays may meet.
std::size_t bytes_of_rocks(const PointScenery& scenery) {
  return engine::bytes_of_rocks(scenery.request.detail.get(), engine::kMaxCachedRocks);
}

// Returns an irradiance for each place; empty for an empty place, and for all without indirect light.
std::vector<std::optional<engine::Irradiance>> light_of(const EndpointContext& context, const PointScenery& scenery,
                                                        const std::optional<dem::MapError>& map_error,
                                                        std::span<const std::optional<engine::LitPlace>> places) {
  std::vector<std::optional<engine::Irradiance>> irradiances(places.size());
  if (!scenery.request.indirect.any()) return irradiances;
  std::vector<engine::LitPlace> present;
  for (const auto& place : places)
    if (place) present.push_back(*place);
  const auto light = context.renderer.query(scenery.request.detail, map_error, context.stop,
                                            [&](const engine::RenderContext& rendering) {
                                              return engine::light_at_places(present, scenery.request, rendering);
                                            });
  auto next_light = light.begin();  // `light` has an element for each place that is not empty, in the same order
  for (std::size_t i = 0; i < places.size(); ++i)
    if (places[i]) irradiances[i] = *next_light++;
  return irradiances;
}

std::vector<engine::SceneObject> scene_objects(const std::vector<PlacedObject>& placed) {
  std::vector<engine::SceneObject> objects;
  objects.reserve(placed.size());
  for (const PlacedObject& p : placed) objects.push_back(p.object);
  return objects;
}

// Returns the answer that npz(light) or json(light) makes from the light at the places, with a warning of an eclipse.
Response lit_answer(const EndpointContext& context, std::string_view media_type, const auto& query,
                    const std::optional<dem::MapError>& map_error,
                    std::span<const std::optional<engine::LitPlace>> places, const auto& npz, const auto& json) {
  const auto light = light_of(context, query, map_error, places);
  context.stop.check();
  Response response =
      negotiated(context, media_type, media_type == "application/json" ? json_line(json(light)) : npz(light));
  OrderedJson warnings = OrderedJson::array();
  warn_of_eclipse(sun_covered(query), "", warnings);
  add_warnings(response, warnings);
  return response;
}

}  // namespace

Response answer_rays(const EndpointContext& context) {
  const std::string_view media_type = accepted(context, kRaysAnswers);
  const Body body = parse_body(context);
  const RaysQuery query =
      read_rays(body.json, context.limits, context.assets, context.stop, body.arrays, ground_heights(context));
  claim_memory(context, query.rays.size(), "/rays", bytes_of_rocks(query));
  const auto map_error = MapErrorQuery::of(query.map_error);
  const auto hits = with_refusals_at({}, "/rays", [&] {
    return context.renderer.query(query.request.detail, map_error, context.stop,
                                  [&](const engine::RenderContext& rendering) {
                                    return engine::cast_rays(query.rays, scene_objects(query.objects), query.sun(),
                                                             rendering, query.min_post_spacing_m);
                                  });
  });
  // Light from terrain is computed for terrain only, not for objects and rocks.
  std::vector<std::optional<engine::LitPlace>> places;
  places.reserve(hits.size());
  for (const engine::RayHit& hit : hits)
    places.push_back(hit.hit && !hit.object && !hit.rock
                         ? std::optional(engine::LitPlace{hit.position_m, hit.normal, hit.incident})
                         : std::nullopt);
  return lit_answer(
      context, media_type, query, map_error, places,
      [&](const auto& light) { return rays_npz(hits, light, query, context.stop); },
      [&](const auto& light) { return rays_json(hits, light, query); });
}

Response answer_project(const EndpointContext& context) {
  const std::string_view media_type = accepted(context, kLandmarkAnswers);
  const Body body = parse_body(context);
  const ProjectQuery query =
      read_project(body.json, context.limits, context.assets, context.stop, body.arrays, ground_heights(context));
  claim_memory(context, query.points.size(), "/points",
               engine::bytes_of_rows(query.camera, query.shutter) + bytes_of_rocks(query));
  constexpr MemberPointer kRefusable[] = {{"shutter", "/shutter"}, {"rays", "/points"}};
  const auto landmarks = with_refusals_at(kRefusable, "/pose", [&] {
    return context.renderer.query(query.request.detail, context.stop, [&](const engine::RenderContext& rendering) {
      return engine::project_landmarks(query.camera, query.pose, query.shutter, query.points,
                                       scene_objects(query.objects), query.sun(), rendering);
    });
  });
  std::vector<std::optional<engine::LitPlace>> places;
  places.reserve(landmarks.size());
  for (const engine::Landmark& landmark : landmarks) places.push_back(landmark.place);
  const dem::Catalogue& catalogue = context.renderer.terrain().catalogue();
  return lit_answer(
      context, media_type, query, std::nullopt, places,
      [&](const auto& light) { return landmarks_npz(landmarks, light, query, catalogue, context.stop); },
      [&](const auto& light) { return landmarks_json(landmarks, light, query, catalogue); });
}

Response answer_heights(const EndpointContext& context) {
  const HeightsQuery query = read_heights(json_body(context), context.limits, context.assets, context.stop);
  claim_memory(context, query.points.size(), "/points");
  const std::shared_ptr<const dem::Terrain> terrain =
      context.renderer.terrain_with(query.detail.content, MapErrorQuery::of(query.map_error));
  OrderedJson list = OrderedJson::array();
  for (const Geographic& place : query.points) {
    list.push_back(
        height_answer().write({terrain->height(place.lat_deg, place.lon_deg, context.stop), terrain->catalogue()}));
    context.stop.check();
  }
  return json_response(with_map_error({{"points", std::move(list)}}, query.map_error));
}

Response answer_height(const EndpointContext& context) {
  const Geographic point = read_height_query(context.request.query);
  claim_memory(context, 1, "");
  const dem::Terrain& terrain = context.renderer.terrain();
  const dem::HeightAnswer height = terrain.height(point.lat_deg, point.lon_deg, context.stop);
  context.stop.check();
  return json_response(height_answer().write({height, terrain.catalogue()}));
}

namespace {

constexpr const char* kInOrder = "In the order of the request";

OrderedJson list_of(const char* name, const OrderedJson& item, std::size_t max_count, const char* description) {
  return schema::object("In the order of the request.", {{name, schema::list(item, max_count, description)}}, {name});
}

// Returns the schema of such a list, and of the errors of the map that it is from.
OrderedJson list_from_map(const char* name, const OrderedJson& item, std::size_t max_count, const char* description) {
  return schema::object(
      "In the order of the request.",
      {{name, schema::list(item, max_count, description)},
       {"map_error", schema::free_object("for a request with `map_error`: as in the metadata of maps")}},
      {name});
}

}  // namespace

void describe_rays(Operation& o) {
  o.body("/v1/rays", rays_members());
  o.accepts_arrays(
      "The request's JSON as the text `request`, and `origin_m` and `direction` (..., 3) instead of `rays`; one row of "
      "either may stand for many of the other: numpy.savez(file, origin_m=..., direction=..., request=json)");
  o.answer_as_accepted(kRaysAnswers, "RaysAnswer", {"Vary", "Selenograph-Warnings"});
  o.schema("RaysAnswer", list_from_map("rays", hit_answer().schema(), o.max_points(), "hits"));
}

void describe_project(Operation& o) {
  o.body("/v1/project", project_members());
  o.accepts_arrays(
      "The request's JSON as the text `request`, and `points` (..., 2) or (..., 3) instead of its list: lat_deg, "
      "lon_deg and height_m, NaN: on the terrain");
  o.answer_as_accepted(kLandmarkAnswers, "ProjectAnswer", {"Vary", "Selenograph-Warnings"});
  o.schema("ProjectAnswer", list_of("points", landmark_answer().schema(), o.max_points(), "landmarks"));
}

void describe_heights(Operation& o) {
  o.body("/v1/heights", heights_members());
  o.answer(kInOrder, "HeightsAnswer", list_from_map("points", schema::ref("Height"), o.max_points(), "places"));
}

void describe_height(Operation& o) {
  const std::string place_schema = "#/components/schemas/Place/properties/";
  o.parameter("lat_deg", "query", "planetocentric latitude", true, {{"$ref", place_schema + "lat_deg"}});
  o.parameter("lon_deg", "query", "east longitude", true, {{"$ref", place_schema + "lon_deg"}});
  o.answer("The height", "Height", height_answer().schema());
}

}  // namespace selenograph::api
