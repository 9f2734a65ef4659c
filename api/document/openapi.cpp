#include "api/document/openapi.h"

#include "api/answers/metadata.h"
#include "api/document/requests.h"
#include "api/endpoints/routes.h"
#include "api/message/problem.h"
#include "api/message/version.h"
#include "api/requests/parts/surface_json.h"

namespace selenograph::api {
namespace {

// Returns false for 499, which is never sent: it is listed only in the table of errors in info.description.
bool is_documented_response(const ErrorRow& row) { return row.status != 499; }

// Returns true if a call can be answered with this status: only such statuses are documented for it.
bool can_answer(const Route& route, int status) {
  switch (status) {
    case 404:
      return route.path.find('{') != std::string_view::npos;  // only a path with a parameter may name nothing
    case 408:
    case 413:
    case 415:
      return route.has_body();
    case 422:  // calls without admission have no members to be at fault,
    case 504:  // and take no time
      return route.admission;
    case 500:
      return route.reads_terrain;
    default:
      return true;
  }
}

std::string response_name(int status) { return "Problem" + std::to_string(status); }

// Returns one response per status, described by the titles of the codes that share it, which are its examples.
OrderedJson problem_responses() {
  OrderedJson responses = OrderedJson::object();
  for (const ErrorRow& row : error_table()) {
    if (!is_documented_response(row)) continue;
    OrderedJson& response = responses[response_name(row.status)];
    if (response.is_null()) {
      response = {{"description", row.title},
                  {"content", {{"application/problem+json", {{"schema", schema::ref("Problem")}}}}}};
      if (row.status == 503) response["headers"]["Retry-After"] = {{"$ref", "#/components/headers/Retry-After"}};
      if (row.status == 405) response["headers"]["Allow"] = {{"$ref", "#/components/headers/Allow"}};
    } else {
      response["description"] = response["description"].get<std::string>() + "; " + std::string(row.title);
    }
    response["content"]["application/problem+json"]["examples"][std::string(row.code)] = {
        {"summary", row.meaning},
        {"value",
         {{"type", problem_type(row)}, {"title", row.title}, {"status", row.status}, {"detail", row.meaning}}}};
  }
  return responses;
}

// Adds a reference to the response of each status with which the call can fail.
void add_problems(OrderedJson& responses, const Route& route) {
  for (const ErrorRow& row : error_table()) {
    if (!is_documented_response(row) || !can_answer(route, row.status)) continue;
    responses[std::to_string(row.status)] = {{"$ref", "#/components/responses/" + response_name(row.status)}};
  }
}

OrderedJson header(const char* description, const char* type = "string") {
  return {{"description", description}, {"schema", {{"type", type}}}};
}

OrderedJson headers() {
  OrderedJson list{
      {"ETag", header("Strong: stands for the answer's bytes. Absent when a warning says that a coarser layer replaced "
                      "an unusable file")},
      {"Vary", header("Accept")},
      {"Server-Timing",
       header("Durations in ms. queue, parse, select, build, indirect, visibility, sensor, craters, encode and "
              "other add up to total, from the complete request to the finished answer. pyramid and load are parts "
              "of select and build; relief (heights around its posts), views (the ground that they see), sunlit and "
              "bounces (light on that ground) and gather are parts of indirect; draw, resolve and shadow are parts of "
              "visibility by z-buffer; touch is the system's time meanwhile, most of it for memory touched for the "
              "first time")},
      {"Selenograph-Product", header("For npy and raw answers: the product")},
      {"Selenograph-Shape", header("For npy and raw answers: height,width or height,width,3")},
      {"Selenograph-Dtype", header("For npy and raw answers: NumPy's name, e.g. <f4")},
      {"Selenograph-Missing-Fraction",
       header("Share of pixels that see the Moon where there is no data; absent when there are none", "number")},
      {"Selenograph-Warnings",
       header(
           "The metadata's warnings, those of several cameras with their names, as compact ASCII "
           "JSON; of rays and points those of an eclipse, of what is in the sky those of its epoch; absent when there "
           "are none")},
      {"Selenograph-Echo", header("The request's `echo`, as compact ASCII JSON; absent when it has none")},
      {"Retry-After", header("Seconds", "integer")},
      {"Allow", header("The methods that the path has")}};
  list["Selenograph-Meta"] = {{"description",
                               "For npy and raw answers: the frame's metadata, compact ASCII JSON of at most 6000 "
                               "bytes; metadata_at is the path of the complete metadata, if longer"},
                              {"content", {{"application/json", OrderedJson::object()}}}};
  list["Selenograph-Meta"]["content"]["application/json"]["schema"] = {
      {"anyOf", {schema::ref("FrameMetadata"), schema::ref("MetadataElsewhere")}}};
  return list;
}

OrderedJson text_answer(const char* description, const char* media_type) {
  return {{"description", description}, {"content", {{media_type, {{"schema", {{"type", "string"}}}}}}}};
}

// Adds the problems of a request that is rejected before it reaches a call.
void add_http_problems(OrderedJson& responses) {
  for (const int status : {400, 403, 405, 414, 421}) {
    responses[std::to_string(status)] = {{"$ref", "#/components/responses/" + response_name(status)}};
  }
}

// Adds the paths that server/ answers itself: health and metrics.
void add_operator_paths(OrderedJson& paths) {
  const auto add = [&](const char* path, const char* id, const char* summary, OrderedJson answer) {
    OrderedJson operation{{"operationId", id}, {"summary", summary}, {"tags", {"service"}}};
    operation["responses"]["200"] = std::move(answer);
    add_http_problems(operation["responses"]);
    paths[path]["get"] = operation;
  };
  add("/health/live", "isLive", "Whether the process runs", text_answer("It does", "text/plain"));
  add("/health/ready", "isReady", "Whether requests are taken", text_answer("They are", "text/plain"));
  paths["/health/ready"]["get"]["responses"]["503"] = text_answer("Shutting down", "text/plain");
  add("/metrics", "getMetrics", "Metrics for the operator", text_answer("Prometheus text format 0.0.4", "text/plain"));
}

std::string description() {
  std::string out =
      "Frames of the Moon on request: the view of a camera at a pose under a Sun, with ground truth for every pixel.\n"
      "\n"
      "Frame MOON_ME (mean Earth / polar axis, DE421), metres, degrees in this interface; heights above the sphere of "
      "1 737 400 m. Camera axes are OpenCV's, the centre of the top-left pixel is (0, 0).\n"
      "\n"
      "## Reflectance\n"
      "\n" +
      std::string(normalisation(engine::ReflectanceModel::lommel_seeliger)) + "\n\n" +
      std::string(normalisation_elsewhere()) +
      "\n\n## Request ids\n\nEvery answer has `X-Request-Id`, as has the operator's log: the request's, if it is 1 to "
      "64 letters, digits, `.`, `_` and `-`, or a generated one.\n\n## Errors\n\napplication/problem+json (RFC "
      "9457):\n\n| code | status | meaning |\n|---|---|---|\n";
  for (const ErrorRow& row : error_table()) {
    out +=
        "| `" + std::string(row.code) + "` | " + std::to_string(row.status) + " | " + std::string(row.meaning) + " |\n";
  }
  return out;
}

OrderedJson problem_schema() {
  using namespace schema;
  const OrderedJson finding = object(
      "",
      {{"pointer", text("JSON Pointer (RFC 6901) to the offending member")}, {"detail", text("what is wrong with it")}},
      {"pointer", "detail"});
  return object("RFC 9457.",
                {{"type", {{"type", "string"}, {"format", "uri"}, {"description", "urn:selenograph:problem:CODE"}}},
                 {"title", text("the same for every problem of this type")},
                 {"status", integer(400, 599, "HTTP status")},
                 {"detail", text("about this one")},
                 {"errors", array(finding)}},
                {"type", "title", "status", "detail"});
}

// Returns the document's `components`. `answers`: schemas of the answers, by name.
OrderedJson components(const Limits& limits, const OrderedJson& answers) {
  OrderedJson schemas = OrderedJson::object();
  for (const MemberTable* table : request_tables()) schemas[std::string(table->name())] = table->schema(limits);
  schemas.update(answers);
  schemas["Problem"] = problem_schema();
  const OrderedJson timeout = parameter_json(
      "Request-Timeout-Ms", "header",
      "Time limit in milliseconds, after which the answer is 504; at most the service's own deadline",
      /*required=*/false, {{"type", "integer"}, {"minimum", 1}, {"default", limits.default_deadline.count()}});
  return {{"schemas", schemas},
          {"responses", problem_responses()},
          {"headers", headers()},
          {"parameters", {{"Request-Timeout-Ms", timeout}}}};
}

// Returns the calls, and adds the components that they name to `schemas`.
OrderedJson paths_of(const Limits& limits, OrderedJson& schemas) {
  OrderedJson paths = OrderedJson::object();
  for (const Route& route : kRoutes) {
    Operation described(limits);
    if (route.admission)
      described.json["parameters"].push_back({{"$ref", "#/components/parameters/Request-Timeout-Ms"}});
    route.describe(described);
    OrderedJson operation{{"operationId", route.operation_id}, {"summary", route.summary}, {"tags", {route.tag}}};
    operation.update(described.json);
    add_problems(operation["responses"], route);
    paths[std::string(route.path)][route.method == "GET" ? "get" : "post"] = operation;
    schemas.update(described.schemas);
  }
  add_operator_paths(paths);
  return paths;
}

}  // namespace

OrderedJson openapi_document(const Limits& limits) {
  OrderedJson answers = OrderedJson::object();
  const OrderedJson paths = paths_of(limits, answers);
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
          {"paths", paths},
          {"components", components(limits, answers)}};
}

}  // namespace selenograph::api
