// POST /v1/maps, from the body to the bytes of the answer.
#include <fmt/format.h>

#include "api/answers/map_answer.h"
#include "api/answers/metadata.h"
#include "api/endpoints/routes.h"
#include "dem/base/error.h"
#include "engine/maps/render_map.h"
#include "engine/support/stopwatch.h"

namespace selenograph::api {
namespace {

constexpr MemberPointer kRefusableOfMap[] = {
    {"gsd_m", "/map/gsd_m"}, {"albedo_maps", "/surface/albedo_maps"}, {"indirect", "/indirect/spacing_px"}};

// Renders a map; errors of the engine become errors of the request's members.
engine::Map render_map(const MapQuery& query, const EndpointContext& context) {
  try {
    return with_refusals_at(kRefusableOfMap, "/map", [&] {
      return context.renderer.query(
          query.request.scenery.detail, MapErrorQuery::of(query.map_error), context.stop,
          [&](const engine::RenderContext& rendering) { return engine::render_map(query.request, rendering); });
    });
  } catch (const TooMuchWork& e) {
    refuse_work(e, "/map", context.limits);
  }
}

}  // namespace

Response answer_maps(const EndpointContext& context) {
  engine::Stopwatch watch;
  const MapQuery query = read_map(json_body(context), context.limits, context.assets, context.stop);
  const std::string_view media_type =
      accepted(context, kMapAnswers, [&](std::string_view type) { return holds_map(query, type); });
  check_map_answer(query, media_type);
  const std::string hash = content_hash(query, context.renderer.scene_bytes(),
                                        context.renderer.terrain().catalogue().fingerprint(), media_type);
  Response response;
  response.headers = {{"ETag", "\"" + hash + "\""}, {"Vary", "Accept"}};
  if (const std::string etags = header(context.request, "if-none-match"); !etags.empty() && names_etag(etags, hash)) {
    response.status = 304;
    return response;
  }
  const double parse_ms = watch.lap_ms();
  context.memory.claim_work(bytes_of(query.request), "/map", context.stop);
  const engine::Map map = render_map(query, context);
  context.stop.check();
  watch.lap_ms();  // the lap of encoding begins here: the renderer has measured its own stages
  response.content_type = media_type;
  response.body = encode_map(query, map, hash, media_type, context.stop);
  // Remove the ETag if a coarser layer replaced an unusable file: the hash assumes that every file is usable.
  if (!map.report.warnings.empty()) response.headers.erase(response.headers.begin());
  if (map.report.missing_fraction > 0)
    response.headers.emplace_back("Selenograph-Missing-Fraction", fmt::format("{:.6g}", map.report.missing_fraction));
  response.stages = {{"parse", parse_ms}, {"select", map.times.select_ms}, {"build", map.times.build_ms}};
  add_indirect(map.times, response.stages);
  response.stages.insert(response.stages.end(), {{"visibility", map.times.visibility_ms}, {"encode", watch.lap_ms()}});
  context.stop.check();
  return response;
}

void describe_maps(Operation& o) {
  o.describe(
      "Vertical rays through the pixels' centres: the terrain, shadows and level of detail of frames on a map's grid. "
      "If-None-Match is answered with 304 as for frames.");
  o.may_be_not_modified("The client has this map already");
  o.body("/v1/maps", map_members());
  o.answer_as_accepted(kMapAnswers, "", {"ETag", "Vary", "Server-Timing", "Selenograph-Missing-Fraction"});
}

}  // namespace selenograph::api
