// POST /v1/lidar.
#include <fmt/format.h>

#include "api/answers/lidar_answer.h"
#include "api/endpoints/routes.h"
#include "engine/frame/needs.h"
#include "engine/lidar/lidar_scan.h"

namespace selenograph::api {
namespace {

// Rejects JSON for more beams than a request has rays: as text they would be many times as large as the arrays.
void reject_long_json(const LidarQuery& query, const Limits& limits) {
  if (query.beams <= static_cast<std::size_t>(limits.max_rays)) return;
  const std::string why = fmt::format("{} beams are too many for JSON, which has up to {}: accept application/x-npz",
                                      query.beams, limits.max_rays);
  throw RequestError("not_acceptable", why);
}

}  // namespace

Response answer_lidar(const EndpointContext& context) {
  const std::string_view media_type = accepted(context, kLidarAnswers);
  const Body body = parse_body(context);
  const LidarQuery query =
      read_lidar(body.json, body.arrays, context.limits, context.assets, context.stop, ground_heights(context));
  const bool json = media_type == "application/json";
  if (json) reject_long_json(query, context.limits);
  constexpr std::size_t kJsonBytesPerBeam = 8000;  // as JSON values and as text
  // A beam takes the engine's record and, in the answer, at most as much again as arrays, or JSON.
  context.memory.claim_work((engine::kBytesOfBeam + (json ? kJsonBytesPerBeam : engine::kBytesOfBeam)) * query.beams +
                                engine::bytes_of_rocks(query.request.scenery.detail.get(), engine::kMaxCachedRocks),
                            query.request.pulses.empty() ? "/pattern" : "/pulses", context.stop);
  constexpr MemberPointer kRefusable[] = {{"pose", "/pose"}, {"poses", "/motion/poses"}, {"craters", "/craters"}};
  const engine::LidarReturns returns = with_refusals_at(kRefusable, "/pose", [&] {
    return context.renderer.query(
        query.request.scenery.detail, context.stop,
        [&](const engine::RenderContext& rendering) { return engine::scan_lidar(query.request, rendering); });
  });
  return negotiated(
      context, media_type,
      json ? json_line(lidar_json(returns, query, context.stop)) : lidar_npz(returns, query, context.stop));
}

void describe_lidar(Operation& o) {
  static const std::string text =
      "A lidar's scan of terrain with detail, rocks and objects, as fine as its beams need. A beam is a Gaussian of "
      "sub-rays; its echo "
      "is the sum of their returns (the surface's reflectance at zero phase over range^2), spread over the pulse and "
      "over the slope that each part of the beam illuminates. Resolved returns are detected at random, as a function "
      "of seed, scan and beam; ground truth comes with the measurements. Columns:\n" +
      lidar_columns_text();
  o.describe(text.c_str());
  o.body("/v1/lidar", lidar_members());
  o.accepts_arrays(
      "The request's JSON as the text `request`, and `direction` (n, 3; camera axes) with `time_s` (n, or one number; "
      "0 without) instead of `pulses`");
  o.answer_as_accepted(kLidarAnswers, "LidarAnswer", {"Vary"});
  o.schema("LidarAnswer",
           schema::object("The beams.",
                          {{"returns", schema::array(lidar_return_schema(), "in the order in which they are fired")},
                           {"meta", OrderedJson{{"type", "object"},
                                                {"description",
                                                 "the resolved request; `shape`: rows and columns of a pattern that is "
                                                 "an image; `expected_false_alarms` of a pulse; `warnings`"}}}},
                          {"returns", "meta"}));
}

}  // namespace selenograph::api
