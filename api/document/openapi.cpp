#include "api/document/openapi.h"

#include <initializer_list>
#include <span>

#include "api/answers/map_answer.h"
#include "api/answers/metadata.h"
#include "api/encode/negotiate.h"
#include "api/message/problem.h"
#include "api/message/routes.h"
#include "api/requests/features_json.h"
#include "api/requests/parts/surface_json.h"

namespace selenograph::api {
namespace {

OrderedJson schema_ref(const std::string& name) { return {{"$ref", "#/components/schemas/" + name}}; }

OrderedJson json_content(const std::string& schema) { return {{"application/json", {{"schema", schema_ref(schema)}}}}; }

// 501 belongs to no method and 499 is never sent; both are in the table of info.description.
bool answered_by_calls(const ErrorRow& row) { return row.status != 499 && row.status != 501; }

// Whether a call can be answered with this status at all: what is documented is what a client must be ready for.
bool can_answer(const Route& route, int status) {
  const bool computes = route.endpoint != Endpoint::datasets && route.endpoint != Endpoint::openapi &&
                        route.endpoint != Endpoint::frame_metadata;
  switch (status) {
    case 404:
      return route.endpoint == Endpoint::frame_metadata;  // elsewhere no path is it
    case 413:
    case 415:
      return route.has_body();
    case 422:
    case 504:
      return computes;
    case 500:
      return computes && route.endpoint != Endpoint::verify_mertis;  // those that read terrain
    default:
      return true;
  }
}

std::string response_name(int status) { return "Problem" + std::to_string(status); }

// One response per status; codes that share a status are its examples.
OrderedJson problem_responses() {
  OrderedJson responses = OrderedJson::object();
  for (const ErrorRow& row : error_table()) {
    if (!answered_by_calls(row)) continue;
    OrderedJson& response = responses[response_name(row.status)];
    if (response.is_null()) {
      response = {{"description", row.title},
                  {"content", {{"application/problem+json", {{"schema", schema_ref("Problem")}}}}}};
      if (row.status == 503) response["headers"]["Retry-After"] = {{"$ref", "#/components/headers/Retry-After"}};
      if (row.status == 405) response["headers"]["Allow"] = {{"$ref", "#/components/headers/Allow"}};
    }
    response["content"]["application/problem+json"]["examples"][std::string(row.code)] = {
        {"summary", row.meaning},
        {"value",
         {{"type", problem_type(row)}, {"title", row.title}, {"status", row.status}, {"detail", row.meaning}}}};
  }
  return responses;
}

void add_problems(OrderedJson& responses, const Route& route) {
  for (const ErrorRow& row : error_table()) {
    if (!answered_by_calls(row) || !can_answer(route, row.status)) continue;
    responses[std::to_string(row.status)] = {{"$ref", "#/components/responses/" + response_name(row.status)}};
  }
}

OrderedJson header(const char* description, const char* type = "string") {
  return {{"description", description}, {"schema", {{"type", type}}}};
}

OrderedJson headers() {
  OrderedJson all{
      {"ETag", header("Strong: stands for the answer's bytes. Absent when a warning says that a coarser layer replaced "
                      "an unusable file")},
      {"Vary", header("Accept")},
      {"Server-Timing",
       header("Durations in ms of queue, parse, select, build (pyramid and load: what both waited for), "
              "visibility (of which, by z-buffer, draw, resolve and shadow), sensor, encode; touch: "
              "the system's time meanwhile, most of it for memory touched for the first time")},
      {"Selenograph-Product", header("Of npy and raw answers: the product")},
      {"Selenograph-Shape", header("Of npy and raw answers: height,width or height,width,3")},
      {"Selenograph-Dtype", header("Of npy and raw answers: NumPy's name, e.g. <f4")},
      {"Selenograph-Missing-Fraction", header("Share of pixels that look at the Moon where there is no data; absent "
                                              "when there are none",
                                              "number")},
      {"Selenograph-Echo", header("The request's `echo`, as compact ASCII JSON; absent when it has none")},
      {"Retry-After", header("Seconds", "integer")},
      {"Allow", header("The methods that the path has")}};
  all["Selenograph-Meta"] = {{"description",
                              "Of npy and raw answers: the frame's metadata, compact ASCII JSON of at "
                              "most 6000 bytes; metadata_at says where all of it is, if it is longer"},
                             {"content", json_content("FrameMetadata")}};
  all["Selenograph-Meta"]["content"]["application/json"]["schema"] = {
      {"anyOf", {schema_ref("FrameMetadata"), schema_ref("MetadataElsewhere")}}};
  return all;
}

OrderedJson frame_answer() {
  OrderedJson content = OrderedJson::object();
  std::string description =
      "The frame, as `Accept` asks. Without a preference: image alone as PNG, one product as .npy, several as .npz.\n";
  for (const Representation& r : representations()) {
    content[std::string(r.media_type)] = {{"schema", {{"type", "string"}, {"contentMediaType", r.media_type}}}};
    description += "\n- `" + std::string(r.media_type) + "`: " + std::string(r.meaning);
  }
  OrderedJson answer{{"description", description}, {"headers", OrderedJson::object()}, {"content", content}};
  for (const char* name :
       {"ETag", "Vary", "Server-Timing", "Selenograph-Product", "Selenograph-Shape", "Selenograph-Dtype",
        "Selenograph-Meta", "Selenograph-Missing-Fraction", "Selenograph-Echo"}) {
    answer["headers"][name] = {{"$ref", std::string("#/components/headers/") + name}};
  }
  return answer;
}

// The answer in each of its media types: JSON is described, the others are bytes.
OrderedJson answer_as_accepted(std::span<const Alternative> alternatives, const char* json_schema,
                               std::initializer_list<const char*> headers) {
  std::string description = "As `Accept` asks; without a preference the first.\n";
  OrderedJson content = OrderedJson::object();
  for (const Alternative& a : alternatives) {
    const std::string media_type(a.media_type);
    content[media_type] = {{"schema", media_type == "application/json"
                                          ? schema_ref(json_schema)
                                          : OrderedJson{{"type", "string"}, {"contentMediaType", media_type}}}};
    description += "\n- `" + media_type + "`: " + std::string(a.meaning);
  }
  OrderedJson answer{{"description", description}, {"headers", OrderedJson::object()}, {"content", content}};
  for (const char* name : headers) answer["headers"][name] = {{"$ref", std::string("#/components/headers/") + name}};
  return answer;
}

OrderedJson body(const std::string& schema, OrderedJson examples) {
  OrderedJson json{{"required", true}, {"content", json_content(schema)}};
  for (auto& [name, value] : examples.items()) {
    json["content"]["application/json"]["examples"][name] = {{"value", value}};
  }
  return json;
}

OrderedJson parameter(const char* name, const char* in, const char* description, bool required, OrderedJson schema) {
  return {
      {"name", name}, {"in", in}, {"description", description}, {"required", required}, {"schema", std::move(schema)}};
}

OrderedJson timeout_parameter() { return {{"$ref", "#/components/parameters/Request-Timeout-Ms"}}; }

void fill_frames(OrderedJson& operation) {
  operation["description"] =
      "A safe question asked with POST because it is long: nothing changes on the service, and the same question gives "
      "the same bytes. Therefore If-None-Match is answered with 304 as for GET, without rendering anything.";
  operation["parameters"] = {timeout_parameter(), parameter("If-None-Match", "header", "ETags that the client has",
                                                            false, {{"type", "string"}})};
  operation["requestBody"] = body("FrameRequest", frame_examples());
  operation["responses"]["200"] = frame_answer();
  operation["responses"]["304"] = {{"description", "The client has this frame already"},
                                   {"headers", {{"ETag", {{"$ref", "#/components/headers/ETag"}}}}}};
}

void fill_maps(OrderedJson& operation) {
  operation["description"] =
      "Vertical rays through the pixels' centres: the terrain, shadows and level of detail of frames on a map's grid. "
      "If-None-Match is answered with 304 as for frames.";
  operation["parameters"] = {timeout_parameter(), parameter("If-None-Match", "header", "ETags that the client has",
                                                            false, {{"type", "string"}})};
  operation["requestBody"] = body("MapRequest", map_examples());
  operation["responses"]["200"] =
      answer_as_accepted(kMapAnswers, "", {"ETag", "Vary", "Server-Timing", "Selenograph-Missing-Fraction"});
  operation["responses"]["304"] = {{"description", "The client has this map already"},
                                   {"headers", {{"ETag", {{"$ref", "#/components/headers/ETag"}}}}}};
}

void fill_points(OrderedJson& operation, const char* request, const char* answer, const OrderedJson& example) {
  operation["parameters"] = OrderedJson::array({timeout_parameter()});
  operation["requestBody"] = body(request, {{"example", example}});
  operation["responses"]["200"] = {{"description", "In the order of the request"}, {"content", json_content(answer)}};
}

OrderedJson place_parameters() {
  const std::string place = "#/components/schemas/Place/properties/";
  return {timeout_parameter(),
          parameter("lat_deg", "query", "planetocentric latitude", true, {{"$ref", place + "lat_deg"}}),
          parameter("lon_deg", "query", "east longitude", true, {{"$ref", place + "lon_deg"}})};
}

void fill_round_trip(OrderedJson& operation, const OrderedJson& place) {
  operation["description"] =
      "The check of the SENSOR++ paper (section 4, figure 5) on the finest tile that holds a place. Mode exact sends "
      "rays through the tile's posts: what differs is the engine's. Mode camera renders frames and resamples what "
      "their pixels see to the posts: what differs is the engine's and the sampling's.";
  operation["parameters"] = OrderedJson::array({timeout_parameter()});
  operation["requestBody"] = body("RoundTripRequest", {{"exact", {{"center", place}}},
                                                       {"camera",
                                                        {{"center", place},
                                                         {"mode", "camera"},
                                                         {"height_m", 20000.0},
                                                         {"posts", 64},
                                                         {"footprint_ratio", 1.0},
                                                         {"max_error_px", 0.0}}}});
  operation["responses"]["200"] = answer_as_accepted(kRoundTripAnswers, "RoundTripAnswer", {"Vary"});
}

void fill_features(OrderedJson& operation) {
  operation["description"] =
      "Truth for crater matchers and hazard detectors: each crater of a detail that the terrain shows, the largest "
      "first. The DEM's posts at its centre decide whether it is shown; one that others of its octave of diameters "
      "cover is left out. The same crater has the same id in every answer.";
  operation["parameters"] = OrderedJson::array({timeout_parameter()});
  operation["requestBody"] =
      body("FeaturesRequest",
           {{"example",
             {{"detail", "highlands"},
              {"region", {{"south_deg", 26.125}, {"north_deg", 26.135}, {"west_deg", 3.63}, {"east_deg", 3.64}}},
              {"smallest_m", 20.0}}}});
  operation["responses"]["200"] = answer_as_accepted(kFeaturesAnswers, "FeaturesAnswer", {"Vary"});
}

void fill(OrderedJson& operation, const Route& route) {
  const OrderedJson frame = frame_examples()["nadir"];
  const OrderedJson place{{"lat_deg", 26.1322}, {"lon_deg", 3.6339}};
  switch (route.endpoint) {
    case Endpoint::frames:
      return fill_frames(operation);
    case Endpoint::frame_metadata:
      operation["parameters"] = {
          parameter("hash", "path", "content_hash of the frame", true, {{"type", "string"}, {"minLength", 1}})};
      operation["responses"]["200"] = {{"description", "All of the frame's metadata"},
                                       {"content", json_content("FrameMetadata")}};
      return;
    case Endpoint::maps:
      return fill_maps(operation);
    case Endpoint::rays:
      return fill_points(operation, "RaysRequest", "RaysAnswer",
                         {{"rays", {{{"origin_m", {1757400.0, 0.0, 0.0}}, {"direction", {-1.0, 0.0, 0.0}}}}}});
    case Endpoint::project:
      return fill_points(operation, "ProjectRequest", "ProjectAnswer",
                         {{"camera", frame["camera"]}, {"pose", frame["pose"]}, {"points", {place}}});
    case Endpoint::heights:
      return fill_points(operation, "HeightsRequest", "HeightsAnswer", {{"points", {place}}});
    case Endpoint::height:
      operation["parameters"] = place_parameters();
      operation["responses"]["200"] = {{"description", "The height"}, {"content", json_content("Height")}};
      return;
    case Endpoint::features:
      return fill_features(operation);
    case Endpoint::datasets:
      operation["responses"]["200"] = {{"description", "The catalogue"}, {"content", json_content("Datasets")}};
      return;
    case Endpoint::verify_round_trip:
      return fill_round_trip(operation, place);
    case Endpoint::verify_mertis:
      return fill_points(operation, "MertisRequest", "MertisAnswer", {{"temperatures_k", {350, 500}}});
    case Endpoint::openapi:
      operation["responses"]["200"] = {{"description", "OpenAPI 3.1"},
                                       {"content", {{"application/json", {{"schema", {{"type", "object"}}}}}}}};
      return;
  }
}

const char* tag(Endpoint endpoint) {
  switch (endpoint) {
    case Endpoint::frames:
    case Endpoint::frame_metadata:
      return "frames";
    case Endpoint::maps:
      return "maps";
    case Endpoint::rays:
    case Endpoint::project:
      return "geometry";
    case Endpoint::heights:
    case Endpoint::height:
    case Endpoint::features:
    case Endpoint::datasets:
      return "terrain";
    case Endpoint::verify_round_trip:
    case Endpoint::verify_mertis:
      return "verification";
    case Endpoint::openapi:
      return "service";
  }
  return "";
}

OrderedJson text_answer(const char* description, const char* media_type) {
  return {{"description", description}, {"content", {{media_type, {{"schema", {{"type", "string"}}}}}}}};
}

// Any path can answer so: the request never gets as far as a call, or there are too many connections.
void add_http_problems(OrderedJson& responses) {
  for (const int status : {400, 405, 408, 414, 431, 503}) {
    responses[std::to_string(status)] = {{"$ref", "#/components/responses/" + response_name(status)}};
  }
}

void add_operator_paths(OrderedJson& paths) {
  const auto add = [&](const char* path, const char* id, const char* summary, OrderedJson answer) {
    OrderedJson operation{{"operationId", id}, {"summary", summary}, {"tags", {"service"}}};
    operation["responses"]["200"] = std::move(answer);
    add_http_problems(operation["responses"]);
    paths[path]["get"] = operation;
  };
  add("/health/live", "isLive", "Whether the process runs", text_answer("It does", "text/plain"));
  add("/health/ready", "isReady", "Whether requests are taken", text_answer("They are", "text/plain"));
  OrderedJson not_now = text_answer("Shutting down, or too many connections", "text/plain");
  not_now["content"]["application/problem+json"] = {{"schema", schema_ref("Problem")}};
  paths["/health/ready"]["get"]["responses"]["503"] = not_now;
  add("/metrics", "getMetrics", "Metrics for the operator", text_answer("Prometheus text format 0.0.4", "text/plain"));
}

std::string description() {
  std::string out =
      "Frames of the Moon on request: what a camera at a pose sees under a Sun, with the truth behind each pixel.\n\n"
      "Frame MOON_ME (mean Earth / polar axis, DE421), metres, degrees at this border; heights above the sphere of 1 "
      "737 400 m. Camera axes are OpenCV's, the centre of the top-left pixel is (0, 0).\n\n"
      "## Reflectance\n\n" +
      std::string(normalisation(engine::ReflectanceModel::lommel_seeliger)) + "\n\n" +
      std::string(normalisation_elsewhere()) +
      "\n\n## Request ids\n\nEvery answer has `X-Request-Id`, which the operator's log has, too: the request's, if it "
      "is 1 to 64 letters, digits, `.`, `_` and `-`, or one of the service's own.\n\n## "
      "Errors\n\napplication/problem+json (RFC 9457):\n\n| code | status | meaning |\n|---|---|---|\n";
  for (const ErrorRow& row : error_table()) {
    out +=
        "| `" + std::string(row.code) + "` | " + std::to_string(row.status) + " | " + std::string(row.meaning) + " |\n";
  }
  return out;
}

OrderedJson components(const Limits& limits) {
  OrderedJson timeout =
      parameter("Request-Timeout-Ms", "header",
                "Gives up after so many milliseconds with 504. More than the service's own deadline counts as that",
                false, {{"type", "integer"}, {"minimum", 1}, {"default", limits.default_deadline.count()}});
  return {{"schemas", openapi_schemas(limits)},
          {"responses", problem_responses()},
          {"headers", headers()},
          {"parameters", {{"Request-Timeout-Ms", timeout}}}};
}

// From 20 km straight down.
OrderedJson nadir_example() {
  const OrderedJson camera{{"width", 1024}, {"height", 1024}, {"fov_deg", 50.0}};
  const OrderedJson site{{"lat_deg", 26.1322}, {"lon_deg", 3.6339}};
  OrderedJson above = site, local = site;
  above["height_m"] = 20000.0;
  local.update({{"azimuth_deg", 90.0}, {"elevation_deg", 15.0}});
  return {{"camera", camera},
          {"pose", {{"geodetic", above}, {"nadir", {{"up_azimuth_deg", 0.0}}}}},
          {"sun", {{"local", local}}}};
}

OrderedJson oblique_example() {
  return {{"camera", {{"width", 1024}, {"height", 1024}, {"fov_deg", 50.0}}},
          {"pose",
           {{"geodetic", {{"lat_deg", 25.0}, {"lon_deg", 2.5}, {"height_m", 30000.0}}},
            {"look_at", {{"lat_deg", 26.1322}, {"lon_deg", 3.6339}}}}},
          {"sun", {{"subsolar", {{"lat_deg", 1.5}, {"lon_deg", 60.0}}}}},
          {"image", {{"bit_depth", 16}}},
          {"products", {"image", "range", "position"}}};
}

OrderedJson quaternion_example() {
  return {{"camera", {{"width", 640}, {"height", 480}, {"fx", 800.0}, {"fy", 800.0}, {"cx", 319.5}, {"cy", 239.5}}},
          {"pose",
           {{"frame", "MOON_PA_DE440"},
            {"position_m", {1757400.0, 0.0, 0.0}},
            {"camera_from_moon", {{"w", 0.5}, {"x", 0.5}, {"y", 0.5}, {"z", -0.5}}}}},
          {"sun", {{"direction", {0.0, 1.0, 0.2}}, {"distance_au", 0.99}}},
          {"surface", {{"reflectance", {{"model", "lunar"}, {"lommel_seeliger_weight", 0.7}, {"rho", 0.12}}}}},
          {"accuracy", {{"max_error_px", 0.5}, {"samples_per_pixel", 4}}}};
}

OrderedJson sensor_example() {
  OrderedJson sensed = nadir_example();
  sensed["band"] = {{"center_um", 0.65}, {"width_um", 0.2}};
  sensed["surface"] = {{"reflectance", {{"model", "hapke"}, {"theta_bar_deg", 10.0}}}};
  sensed["sensor"] = {{"optics",
                       {{"f_number", 5.6},
                        {"point_spread", {{"model", "gaussian"}, {"sigma_px", 0.6}}},
                        {"vignetting", {{"model", "cos4"}}}}},
                      {"detector",
                       {{"pixel_pitch_um", 5.5},
                        {"quantum_efficiency", 0.4},
                        {"integration_time_s", 0.002},
                        {"full_well_e", 13500.0},
                        {"read_noise_e", 13.0},
                        {"prnu", 0.01},
                        {"gain_e_dn", 3.4},
                        {"offset_dn", 40.0},
                        {"bit_depth", 12}}},
                      {"seed", 1},
                      {"frame", 17}};
  sensed["products"] = {"image"};
  return sensed;
}

OrderedJson body_material() { return {{"reflectance", {{"model", "lambert"}, {"rho", 0.3}}}}; }

// A satellite alone, its panels' glint toward the camera: SENSOR++ figure 4.
OrderedJson debris_example() {
  const OrderedJson panel{{"reflectance", {{"model", "blinn_phong"}, {"rho", 0.4}, {"shininess", 300.0}}}};
  const OrderedJson satellite{
      {"mesh", "satellite"},
      {"pose",
       {{"position_m", {1837400.0, 60.0, 0.0}},
        {"moon_from_object", {{"w", 0.407232}, {"x", 0.425716}, {"y", -0.721573}, {"z", -0.363676}}}}},
      {"material", body_material()},
      {"part_materials", {{"panel", panel}}}};
  return {
      {"camera", {{"width", 768}, {"height", 512}, {"fov_deg", 16.0}}},
      {"pose",
       {{"position_m", {1837400.0, 0.0, 0.0}}, {"camera_from_moon", {{"w", 0.5}, {"x", 0.5}, {"y", 0.5}, {"z", 0.5}}}}},
      {"sun", {{"direction", {-0.55, -0.65, 0.5}}}},
      {"objects", {satellite}},
      {"terrain", false},
      {"products", {"radiance", "object_id"}}};
}

OrderedJson object_example() {
  OrderedJson over_the_terrain = nadir_example();
  OrderedJson above = over_the_terrain["pose"]["geodetic"];
  above["height_m"] = 19500.0;
  over_the_terrain["surface"] = {{"reflectance", {{"model", "lunar_lambert"}, {"rho", 0.11}}},
                                 {"albedo_maps", {"made-up-albedo"}}};
  over_the_terrain["objects"] = {{{"mesh", "satellite"},
                                  {"pose", {{"geodetic", above}, {"upright", {{"azimuth_deg", 60.0}}}}},
                                  {"scale", 2.0},
                                  {"material", body_material()}}};
  over_the_terrain["products"] = {"image", "object_id"};
  return over_the_terrain;
}

// A line camera that flies north and keeps looking down: a strip of 4096 rows.
OrderedJson pushbroom_example() {
  OrderedJson pushbroom = nadir_example();
  pushbroom["camera"] = {{"width", 256}, {"height", 4096}, {"fov_deg", 10.0}};
  pushbroom["pose"]["nadir"]["up_azimuth_deg"] = 180.0;
  pushbroom["shutter"] = {{"line_time_s", 0.0085},
                          {"angular_rate_deg_s", {0.052, 0.0, 0.0}},
                          {"velocity_m_s", {-703.0, -45.0, 1436.0}},
                          {"pushbroom", true}};
  pushbroom["products"] = {"radiance", "geodetic"};
  return pushbroom;
}

OrderedJson thermal_example() {
  OrderedJson warm = oblique_example();
  warm.erase("image");
  warm["band"] = {{"response", {{8.0, 0.0}, {9.0, 1.0}, {12.0, 1.0}, {13.0, 0.0}}}};
  warm["surface"] = {{"reflectance", {{"model", "lambert"}, {"rho", 0.1}}}, {"temperature_k", 350.0}};
  warm["products"] = {"radiance", "lit"};
  return warm;
}

}  // namespace

OrderedJson frame_examples() {
  return {{"nadir", nadir_example()},
          {"oblique", oblique_example()},
          {"quaternion", quaternion_example()},
          {"sensor", sensor_example()},
          {"thermal", thermal_example()},
          {"debris", debris_example()},
          {"over_the_terrain", object_example()},
          {"pushbroom", pushbroom_example()}};
}

OrderedJson map_examples() {
  const OrderedJson site{{"lat_deg", 26.1322}, {"lon_deg", 3.6339}};
  OrderedJson local = site;
  local.update({{"azimuth_deg", 90.0}, {"elevation_deg", 15.0}});
  // What a lander that descends here compares its images with.
  const OrderedJson onboard{{"map",
                             {{"projection", "orthographic"},
                              {"center", site},
                              {"width_m", 20000.0},
                              {"height_m", 20000.0},
                              {"gsd_m", 20.0}}},
                            {"sun", {{"local", local}}},
                            {"products", {"radiance", "height"}}};
  const OrderedJson illumination{{"map",
                                  {{"projection", "polar_stereographic"},
                                   {"center", {{"lat_deg", -89.5}, {"lon_deg", 0.0}}},
                                   {"width_m", 20000.0},
                                   {"height_m", 20000.0},
                                   {"gsd_m", 100.0}}},
                                 {"sun", {{"utc", "2026-11-20T00:00:00Z"}}},
                                 {"products", {"lit"}}};
  const OrderedJson slopes{
      {"map",
       {{"projection", "equirectangular"},
        {"bounds", {{"south_deg", 25.5}, {"north_deg", 26.5}, {"west_deg", 3.0}, {"east_deg", 4.0}}},
        {"gsd_m", 100.0}}},
      {"products", {"height", "slope", "normal", "source"}}};
  return {{"onboard", onboard}, {"illumination", illumination}, {"slopes", slopes}};
}

OrderedJson openapi_paths() {
  OrderedJson paths = OrderedJson::object();
  for (const Route& route : kRoutes) {
    OrderedJson operation{
        {"operationId", route.operation_id}, {"summary", route.summary}, {"tags", {tag(route.endpoint)}}};
    fill(operation, route);
    add_problems(operation["responses"], route);
    paths[std::string(route.path)][route.method == "GET" ? "get" : "post"] = operation;
  }
  add_operator_paths(paths);
  return paths;
}

OrderedJson openapi_document(const Limits& limits) {
  return {{"openapi", "3.1.0"},
          {"info",
           {{"title", "selenograph"},
            {"version", software_version()},
            {"summary", "Lunar frames for navigation"},
            {"description", description()},
            {"license", {{"name", "Apache-2.0"}, {"identifier", "Apache-2.0"}}}}},
          {"servers", {{{"url", "/"}, {"description", "where this document came from"}}}},
          {"security", OrderedJson::array()},
          {"tags",
           {{{"name", "frames"}, {"description", "Images and the truth behind each pixel"}},
            {{"name", "maps"}, {"description", "Map-projected products"}},
            {{"name", "geometry"}, {"description", "Rays and landmarks"}},
            {{"name", "terrain"}, {"description", "Heights, craters and the catalogue"}},
            {{"name", "verification"}, {"description", "How true the answers are"}},
            {{"name", "service"}, {"description", "For clients' tools and the operator"}}}},
          {"paths", openapi_paths()},
          {"components", components(limits)}};
}

}  // namespace selenograph::api
