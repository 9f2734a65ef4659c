// All component schemas: the requests' from their tables, the answers', and the problem.
#include "api/document/openapi.h"
#include "api/document/openapi_parts.h"
#include "api/document/requests.h"

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

}  // namespace

OrderedJson openapi_schemas(const Limits& limits) {
  OrderedJson schemas = OrderedJson::object();
  for (const MemberTable* table : request_tables()) schemas[std::string(table->name())] = table->schema(limits);
  add_frame_answers(schemas);
  add_point_answers(schemas, limits);
  add_feature_answers(schemas);
  add_dataset_answers(schemas);
  add_verify_answers(schemas);
  add_problem(schemas);
  return schemas;
}

}  // namespace selenograph::api
