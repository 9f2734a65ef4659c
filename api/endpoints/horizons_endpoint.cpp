// POST /v1/horizons and POST /v1/illumination.
#include "api/answers/horizons_answer.h"
#include "api/endpoints/routes.h"

namespace selenograph::api {
namespace {

constexpr MemberPointer kMembers[] = {{"farthest_km", "/horizon/farthest_km"}};

Response answer_by(const EndpointContext& context, const auto& query, std::span<const Alternative> alternatives) {
  const std::string_view media_type =
      accepted(context, alternatives, [&](std::string_view type) { return holds(query, type); });
  if (!holds(query, media_type))
    throw RequestError("not_acceptable", query.area ? "a map is answered as image/tiff or application/x-npz"
                                                    : "places are not answered as image/tiff");
  context.memory.claim_work(bytes_of(query), query.pointer(), context.stop);
  const auto found = with_refusals_at(kMembers, query.pointer(), [&] {
    return context.renderer.query(
        query.detail.content, MapErrorQuery::of(query.map_error), context.stop,
        [&](const engine::RenderContext& rendering) { return find(query, rendering, context.request.on_progress); });
  });
  return negotiated(context, media_type, encode(query, found, media_type, context.stop));
}

}  // namespace

Response answer_horizons(const EndpointContext& context) {
  const HorizonsQuery query = read_horizons(json_body(context), context.limits, context.assets, context.stop);
  return answer_by(context, query, kHorizonsAnswers);
}

Response answer_illumination(const EndpointContext& context) {
  const IlluminationQuery query = read_illumination(json_body(context), context.limits, context.assets, context.stop);
  return answer_by(context, query, kIlluminationAnswers);
}

void describe_horizons(Operation& o) {
  o.describe(
      "Elevation of the horizon around an eye at or above the ground, with the Moon's curvature and all layers of the "
      "terrain. Ground that would raise a horizon by less than 0.003 degrees may be missed. Void ground is ignored.");
  o.body("/v1/horizons", horizons_members());
  o.answer_as_accepted(kHorizonsAnswers, "HorizonsAnswer", {"Vary"});
  o.schema("HorizonsAnswer", horizons_schema());
}

void describe_illumination(Operation& o) {
  o.describe(
      "Visible shares of the Sun's disc, with limb darkening (as in frames with `sun.limb_darkening` 0.6; their "
      "default is 0), and of the Earth's disc, a sphere of 6371 km, above the horizons of POST /v1/horizons, at "
      "epochs in equal steps. Frames cast exact shadows of their own.");
  o.body("/v1/illumination", illumination_members());
  o.answer_as_accepted(kIlluminationAnswers, "IlluminationAnswer", {"Vary"});
  o.schema("IlluminationAnswer", illumination_schema());
}

}  // namespace selenograph::api
