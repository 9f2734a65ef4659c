// POST /v1/features.
#include "api/encode/negotiate.h"
#include "api/endpoints/endpoint.h"
#include "api/requests/features_json.h"

namespace selenograph::api {

Response answer_features(const EndpointContext& context) {
  const std::string_view media_type =
      choose(header(context.request, "accept"), std::span<const Alternative>(kFeaturesAnswers));
  const FeaturesQuery query = read_features(json_body(context), context.limits, context.assets, context.stop);
  context.memory.need(query.bytes(), "/region", context.stop);
  const FeatureList list(query, context.renderer, context.stop);
  Response response;
  response.content_type = media_type;
  response.body = media_type == "text/csv" ? list.csv() : list.json();
  response.headers.emplace_back("Vary", "Accept");
  context.stop.check();
  return response;
}

}  // namespace selenograph::api
