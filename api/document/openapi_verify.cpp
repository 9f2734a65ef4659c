// The schemas of what POST /v1/verify/* answers.
#include "api/document/openapi_parts.h"
#include "api/json/ranges.h"
#include "api/requests/round_trip_json.h"

namespace selenograph::api {

using namespace schema;

namespace {

OrderedJson group_of_differences(OrderedJson more, const char* description) {
  more["posts"] = integer(0, 1LL << 62, "compared");
  more["mean_m"] = number_or_null("extracted minus original");
  more["mean_absolute_m"] = number_or_null("mean of the differences' sizes");
  more["rms_m"] = number_or_null("root of the mean square");
  more["standard_error_m"] = number_or_null("of the mean, from its scatter over squares of 32 x 32 posts or more");
  more["z"] = number_or_null("mean over standard error: above 3 in size by chance once in 370");
  return object(description, std::move(more), {"posts", "mean_m", "mean_absolute_m", "rms_m", "standard_error_m", "z"});
}

OrderedJson difference_schema() {
  const OrderedJson percentile =
      object("", {{"percent", number({0, 100}, "")}, {"value_m", number_or_null("")}}, {"percent", "value_m"});
  const OrderedJson list{{"type", "array"}, {"items", percentile}};
  return group_of_differences(
      {{"median_m", number_or_null("")},
       {"median_absolute_m", number_or_null("")},
       {"standard_deviation_m", number_or_null("")},
       {"percentiles", list},
       {"absolute_percentiles", list},
       {"worst",
        {{"type", {"object", "null"}}, {"description", "difference_m, lat_deg, lon_deg, original_m of the largest"}}}},
      "All posts.");
}

void add_mertis(OrderedJson& schemas) {
  OrderedJson channel{{"type", "object"},
                      {"description",
                       "center_um, width_um, radiance_w_m2_sr_um (B(T)), flux_w (eq. 9), noise_equivalent_power_w, "
                       "signal_to_noise (eq. 12), width_error: of L Delta lambda against the integral, relative"}};
  OrderedJson spectrum =
      object("", {{"temperature_k", number(kAnyNumber, "K")}, {"channels", {{"type", "array"}, {"items", channel}}}},
             {"temperature_k", "channels"});
  schemas["MertisAnswer"] =
      object("Per temperature and channel.",
             {{"instrument", with(ref("MertisRequest"), "description", "as understood")},
              {"assumptions_of_the_defaults", {{"type", "array"}, {"items", text("an assumption")}}},
              {"spectra", {{"type", "array"}, {"items", spectrum}}}},
             {"instrument", "assumptions_of_the_defaults", "spectra"});
}

void add_round_trip(OrderedJson& schemas) {
  const OrderedJson quadrants{{"type", "array"},
                              {"items", group_of_differences({{"name", text("NW, NE, SW, SE")}}, "Of the window.")}};
  const OrderedJson slopes{
      {"type", "array"},
      {"items", group_of_differences({{"from_deg", number(kAnyNumber, "")}, {"to_deg", number(kAnyNumber, "")}},
                                     "Posts on ground of such slopes.")}};
  schemas["RoundTripAnswer"] = object(
      "Extracted minus original heights.",
      {{"tile", {{"type", "object"}, {"description", "name, post_spacing_m, quantisation_m, posts"}}},
       {"mode", words(kRoundTripModes, "")},
       {"center", ref("Place")},
       {"height_m", number(kStationHeight_m, "of the cameras above the ground")},
       {"footprint_ratio", number(kFootprintRatio, "as asked; mode camera")},
       {"pixel_footprint_m", number(kAnyNumber, "straight below a camera; mode camera")},
       {"max_error_px", number(kMaxError_px, "as asked; mode camera")},
       {"window", {{"type", "object"}, {"description", "rows, columns, and the bounds of the posts"}}},
       {"stations", integer(0, 1LL << 62, "camera positions")},
       {"counts",
        {{"type", "object"},
         {"description",
          "posts = compared + hidden (nearer terrain before them) + missed (nothing met: beside voids, beyond the "
          "last tile) + elsewhere (under a finer tile) + voids"}}},
       {"difference", difference_schema()},
       {"histogram",
        {{"type", "object"},
         {"description",
          "counts of posts in classes of equal width between from_m and to_m; posts below and above them"}}},
       {"quadrants", quadrants},
       {"slopes", slopes},
       {"software", text("name and version")}},
      {"tile", "mode", "center", "height_m", "window", "stations", "counts", "difference", "histogram", "quadrants",
       "slopes"});
}

}  // namespace

void add_verify_answers(OrderedJson& schemas) { add_mertis(schemas), add_round_trip(schemas); }

}  // namespace selenograph::api
