// POST /v1/verify/roundtrip and /v1/verify/mertis.
#include <algorithm>

#include "api/answers/round_trip_answer.h"
#include "api/endpoints/routes.h"
#include "api/requests/mertis_json.h"
#include "dem/base/error.h"

namespace selenograph::api {
namespace {

engine::RoundTrip run_round_trip(const EndpointContext& context, const engine::RoundTripRequest& request) {
  constexpr MemberPointer kRefusableOfTrip[] = {
      {"height_m", "/height_m"}, {"footprint_ratio", "/footprint_ratio"}, {"max_error_px", "/max_error_px"}};
  return with_refusals_at(kRefusableOfTrip, "/center",
                          [&] { return engine::round_trip(context.renderer, request, {}, context.stop); });
}

// Returns an upper bound of a round trip's memory. A post takes its original height, the difference and its share of
// the answer; a pixel of a camera's frame takes the surface properties of the engine.
std::size_t bytes_of(const engine::RoundTripRequest& request) {
  constexpr double kBytesPerPost = 24, kBytesPerPixel = 64;
  constexpr double kMaxTilePosts = 10800, kMaxPostsPerFrame = 1000, kMarginFactor = 1.2;
  const double posts = request.posts > 0 ? request.posts : kMaxTilePosts;  // along a side of the window; 0: all
  // Mode camera covers the window by frames with a margin; mode exact casts rays in groups.
  const double frame_side_px = kMarginFactor * std::min(posts, kMaxPostsPerFrame) / request.footprint_ratio;
  constexpr double kMaxFramePixels = 0x1p25, kRaysAtOnce = 65536;
  const double pixels = request.mode == engine::RoundTripMode::camera
                            ? std::min(frame_side_px * frame_side_px, kMaxFramePixels)
                            : kRaysAtOnce;
  return static_cast<std::size_t>(kBytesPerPost * posts * posts + kBytesPerPixel * pixels);
}

}  // namespace

Response answer_verify_round_trip(const EndpointContext& context) {
  const std::string_view media_type = accepted(context, kRoundTripAnswers);
  const engine::RoundTripRequest request = read_round_trip(json_body(context), context.limits);
  context.memory.claim_work(bytes_of(request), "/posts", context.stop);
  const engine::RoundTrip trip = run_round_trip(context, request);
  return negotiated(context, media_type,
                    media_type == "image/tiff"
                        ? dem::geotiff_bytes(grid_of(trip.window), trip.difference_m, "extracted - original")
                        : json_line(round_trip_answer().write({request, trip, engine::statistics_of(trip)})));
}

Response answer_verify_mertis(const EndpointContext& context) {
  const auto query = read_mertis(json_body(context));
  constexpr std::size_t kBytes = 1 << 20;  // more than the answer's channels take
  context.memory.claim_work(kBytes, "", context.stop);
  return json_response(mertis_answer().write({query, context.stop}));
}

void describe_verify_round_trip(Operation& o) {
  o.describe(
      "The check of the SENSOR++ paper (section 4, figure 5) on the finest tile that contains a point. Mode exact "
      "casts rays through the tile's posts: the difference is the engine's error. Mode camera renders frames and "
      "resamples their pixels to the posts: the difference includes the sampling error.");
  o.body("/v1/verify/roundtrip", round_trip_members());
  o.schema("RoundTripAnswer", round_trip_answer().schema());
  o.answer_as_accepted(kRoundTripAnswers, "RoundTripAnswer", {"Vary"});
}

void describe_verify_mertis(Operation& o) {
  o.body("/v1/verify/mertis", mertis_members());
  o.answer("In the order of the request", "MertisAnswer", mertis_answer().schema());
}

}  // namespace selenograph::api
