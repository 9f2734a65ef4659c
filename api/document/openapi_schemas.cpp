// All component schemas: the requests' from their tables, the answers', and the problem.
#include "api/answers/datasets_answer.h"
#include "api/answers/metadata_members.h"
#include "api/answers/points_answer.h"
#include "api/answers/round_trip_answer.h"
#include "api/document/openapi.h"
#include "api/document/requests.h"
#include "api/requests/mertis_json.h"

namespace selenograph::api {
namespace {

using namespace schema;

void add_problem(OrderedJson& schemas) {
  const OrderedJson finding = object(
      "",
      {{"pointer", text("JSON Pointer (RFC 6901) to the offending member")}, {"detail", text("what is wrong with it")}},
      {"pointer", "detail"});
  schemas["Problem"] =
      object("RFC 9457.",
             {{"type", {{"type", "string"}, {"format", "uri"}, {"description", "urn:selenograph:problem:CODE"}}},
              {"title", text("the same for every problem of this type")},
              {"status", integer(400, 599, "HTTP status")},
              {"detail", text("about this one")},
              {"errors", {{"type", "array"}, {"items", finding}}}},
             {"type", "title", "status", "detail"});
}

// Lists have at most so many elements.
void add_answers(OrderedJson& schemas, std::size_t most) {
  schemas["FrameMetadata"] = metadata_answer().schema();
  schemas["MetadataElsewhere"] =
      object("In the header, where all metadata do not fit.",
             {{"content_hash", text("the ETag without quotes")}, {"metadata_at", text("path of the metadata")}},
             {"content_hash", "metadata_at"});
  const char* const in_order = "In the order of the request.";
  schemas["RaysAnswer"] = object(in_order, {{"rays", list(hit_answer().schema(), most, "hits")}}, {"rays"});
  schemas["ProjectAnswer"] =
      object(in_order, {{"points", list(landmark_answer().schema(), most, "landmarks")}}, {"points"});
  schemas["Height"] = height_answer().schema();
  schemas["HeightsAnswer"] = object(in_order, {{"points", list(ref("Height"), most, "places")}}, {"points"});
  schemas["Datasets"] = datasets_answer().schema();
  schemas["MertisAnswer"] = mertis_answer().schema();
  schemas["RoundTripAnswer"] = round_trip_answer().schema();
}

}  // namespace

OrderedJson openapi_schemas(const Limits& limits) {
  OrderedJson schemas = OrderedJson::object();
  for (const MemberTable* table : request_tables()) schemas[std::string(table->name())] = table->schema(limits);
  add_answers(schemas, static_cast<std::size_t>(limits.max_rays));
  add_feature_answers(schemas);
  add_problem(schemas);
  return schemas;
}

}  // namespace selenograph::api
