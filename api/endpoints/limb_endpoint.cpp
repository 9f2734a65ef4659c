// POST /v1/limb.
#include "api/endpoints/routes.h"
#include "api/requests/limb_json.h"

namespace selenograph::api {

Response answer_limb(const EndpointContext& context) {
  const std::string_view media_type = accepted(context, kLimbAnswers);
  const LimbQuery query =
      read_limb(json_body(context), context.limits, context.assets, context.stop, ground_heights(context));
  // A point takes the engine's record, its rays and its text.
  constexpr std::size_t kBytesPerLimbPoint = 3000;
  context.memory.claim_work(kBytesPerLimbPoint * static_cast<std::size_t>(query.request.points), "/points",
                            context.stop);
  const auto limb = with_refusals_at({}, "/pose", [&] {
    return context.renderer.query(query.detail.content, context.stop, [&](const engine::RenderContext& rendering) {
      return LimbPoints{engine::find_limb(query.request, rendering), engine::find_terminator(query.request, rendering)};
    });
  });
  return negotiated(
      context, media_type,
      media_type == kLimbAnswers[1].media_type ? limb_npz(limb, context.stop) : json_line(limb_json(limb)));
}

void describe_limb(Operation& o) {
  o.describe(
      "Truth for horizon-based navigation: position of the Moon's limb in the image, to 0.01 pixel, at azimuths around "
      "the direction to its centre, and that of a sphere's limb. In the half plane of an azimuth the limb is the "
      "largest angle from the centre at which a ray still meets the finest terrain. Objects and rocks are ignored. "
      "With `sun` also the terminator: the limb as seen from the Sun's centre, i.e. the last lit ground toward the "
      "night in each half plane bounded by the line to the Sun.");
  o.body("/v1/limb", limb_request_members());
  o.answer_as_accepted(kLimbAnswers, "LimbAnswer", {"Vary"});
  o.schema("LimbAnswer",
           schema::object(
               "The limb.",
               {{"points", schema::array(limb_answer().schema(), "in order of azimuth")},
                {"terminator", schema::array(terminator_answer().schema(),
                                             "points of the terminator in order of azimuth; left out without `sun`")}},
               {"points"}));
}

}  // namespace selenograph::api
