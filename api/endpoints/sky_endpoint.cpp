// POST /v1/sky.
#include <algorithm>

#include "api/answers/metadata.h"
#include "api/answers/turned_sky.h"
#include "api/endpoints/routes.h"
#include "api/requests/sky_json.h"
#include "engine/frame/needs.h"
#include "engine/sky/sky_in_view.h"
#include "engine/sky/star_catalogue.h"

namespace selenograph::api {

Response answer_sky(const EndpointContext& context) {
  const std::string_view media_type = accepted(context, kSkyAnswers);
  const SkyQuery query =
      read_sky(json_body(context), context.limits, context.assets, context.stop, ground_heights(context));
  // A star takes the engine's record, its ray and its text.
  constexpr std::size_t kBytesPerStar = 2000;
  const std::size_t stars =
      query.request.sky->stars ? std::min(query.request.sky->stars->size(), engine::kMostStars) : 0;
  constexpr std::size_t kMaxBodies = 100;  // more than Sun, Earth and planets
  context.memory.claim_work(kBytesPerStar * (stars + kMaxBodies) + engine::bytes_of_rocks(query.detail.content.get()) +
                                engine::bytes_of_rows(query.request.camera, query.request.shutter),
                            "/sky", context.stop);
  constexpr MemberPointer kRefusable[] = {{"magnitude_limit", "/sky/magnitude_limit"}, {"shutter", "/shutter"}};
  const auto sky = with_refusals_at(kRefusable, "/pose", [&] {
    return context.renderer.query(query.request.detail, context.stop, [&](const engine::RenderContext& rendering) {
      return engine::query_sky(query.request, rendering);
    });
  });
  Response response = negotiated(
      context, media_type,
      media_type == kSkyAnswers[1].media_type ? sky_npz(sky, query, context.stop) : json_line(sky_json(sky, query)));
  OrderedJson warnings = OrderedJson::array();
  warn_of_turned_sky(query.request, query.icrf_lag_s, warnings);
  add_warnings(response, warnings);
  return response;
}

void describe_sky(Operation& o) {
  o.describe(
      "Truth for star trackers and optical navigation: stars in the image, the brightest first, then the Sun, the "
      "Earth and the planets, wherever they are. A frame with the same `sky` shows them at these positions.");
  o.body("/v1/sky", sky_request_members());
  o.answer_as_accepted(kSkyAnswers, "SkyAnswer", {"Vary", "Selenograph-Warnings"});
  o.schema("SkyAnswer",
           schema::object("What is in the sky.",
                          {{"objects", schema::array(sky_answer().schema(), "stars, then bodies")}}, {"objects"}));
}

}  // namespace selenograph::api
