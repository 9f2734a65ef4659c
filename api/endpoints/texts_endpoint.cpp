// GET /v1/datasets and /openapi.json: texts that are generated once.
#include "api/answers/datasets_answer.h"
#include "api/endpoints/routes.h"

namespace selenograph::api {
namespace {

Response answer_text(const EndpointContext& context, const std::string& text) {
  context.memory.claim_work(text.size(), "", context.stop);
  return json_response(text);
}

}  // namespace

Response answer_datasets(const EndpointContext& context) { return answer_text(context, context.datasets()); }

void describe_datasets(Operation& o) { o.answer("The catalogue", "Datasets", datasets_answer().schema()); }

Response answer_openapi(const EndpointContext& context) { return answer_text(context, context.openapi); }

void describe_openapi(Operation& o) {
  o.json["responses"]["200"] = {{"description", "OpenAPI 3.1"},
                                {"content", {{"application/json", {{"schema", {{"type", "object"}}}}}}}};
}

}  // namespace selenograph::api
