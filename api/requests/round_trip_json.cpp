#include "api/requests/round_trip_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "api/answers/metadata.h"
#include "api/json/ranges.h"
#include "api/requests/parts/pose_json.h"
#include "api/schema/member_kinds.h"

namespace selenograph::api {
namespace {

OrderedJson number_json(double x) { return std::isfinite(x) ? OrderedJson(x) : OrderedJson(nullptr); }

OrderedJson group_json(const engine::GroupStatistics& g) {
  return {{"posts", g.posts},
          {"mean_m", number_json(g.mean_m)},
          {"mean_absolute_m", number_json(g.mean_absolute_m)},
          {"rms_m", number_json(g.rms_m)},
          {"standard_error_m", number_json(g.standard_error_m)},
          {"z", number_json(g.z)}};
}

OrderedJson percentiles_json(const std::vector<engine::Percentile>& percentiles) {
  OrderedJson list = OrderedJson::array();
  for (const engine::Percentile& p : percentiles)
    list.push_back({{"percent", p.percent}, {"value_m", number_json(p.value_m)}});
  return list;
}

OrderedJson worst_json(const engine::RoundTrip& trip, const engine::DifferenceStatistics& s) {
  if (s.worst_row < 0) return nullptr;
  const Geographic g = trip.window.place(s.worst_row, s.worst_col);
  const auto original = trip.original_m[trip.window.index(s.worst_row, s.worst_col)];
  return {{"difference_m", s.worst_m},
          {"lat_deg", g.lat_deg},
          {"lon_deg", g.lon_deg},
          {"original_m", static_cast<double>(original)}};
}

OrderedJson difference_json(const engine::RoundTrip& trip, const engine::DifferenceStatistics& s) {
  OrderedJson json = group_json(s.all);
  json["median_m"] = number_json(s.median_m);
  json["median_absolute_m"] = number_json(s.median_absolute_m);
  json["standard_deviation_m"] = number_json(s.standard_deviation_m);
  json["percentiles"] = percentiles_json(s.percentiles);
  json["absolute_percentiles"] = percentiles_json(s.absolute_percentiles);
  json["worst"] = worst_json(trip, s);
  return json;
}

OrderedJson window_json(const engine::PostWindow& w) {
  const Geographic first = w.place(0, 0), last = w.place(w.height - 1, w.width - 1);
  return {{"rows", w.height},          {"columns", w.width},
          {"south_deg", last.lat_deg}, {"north_deg", first.lat_deg},
          {"west_deg", first.lon_deg}, {"east_deg", last.lon_deg < first.lon_deg ? last.lon_deg + 360 : last.lon_deg}};
}

}  // namespace

namespace {
std::int64_t posts_allowed(const Limits& limits) { return most_posts(limits); }
}  // namespace

std::string_view mode_name(engine::RoundTripMode mode) { return word_of(kRoundTripModes, mode); }

int most_posts(const Limits& limits) {
  return std::max(1, static_cast<int>(std::sqrt(static_cast<double>(limits.max_rays))));
}

int default_posts(const Limits& limits) { return std::min(256, most_posts(limits)); }

const Members<engine::RoundTripRequest>& round_trip_members() {
  using Trip = engine::RoundTripRequest;
  static const auto table = made<Members<Trip>>("RoundTripRequest", "A DEM's way into images and back.", [](auto& m) {
    m.start_from([](const Limits& limits) {
      Trip request;
      request.posts = default_posts(limits);
      return request;
    });
    m.add("center",
          Property{[](const Trip& r) {
                     return std::optional(Geographic{r.lat_deg, r.lon_deg, 0});
                   },
                   [](Trip& r, const Geographic& g) { r.lat_deg = g.lat_deg, r.lon_deg = g.lon_deg; }},
          Object{place_members()}, "the finest tile that holds it is compared")
        .required();
    m.add("height_m", &Trip::height_m, Number{kStationHeight_m, "m"}, "of the cameras above the ground");
    m.add("mode", &Trip::mode, Word{kRoundTripModes}, "exact: rays through the posts; camera: frames");
    m.add("posts", &Trip::posts, Integer{1, posts_allowed}, "along each side of the window; fewer where the tile ends");
    m.add("footprint_ratio", &Trip::footprint_ratio, Number{kFootprintRatio},
          "pixel footprint over post spacing, mode camera");
    m.add("max_error_px", &Trip::max_error_px, Number{kMaxError_px, "px"},
          "of the frames, mode camera; 0: the finest posts");
  });
  return *table;
}

engine::RoundTripRequest read_round_trip(const Json& body, const Limits& limits) {
  const Assets none;
  Findings findings;
  const auto request = round_trip_members().read(JsonReader(body, findings), {limits, none});
  findings.throw_if_any();
  return *request;
}

OrderedJson round_trip_json(const engine::RoundTripRequest& request, const engine::RoundTrip& trip,
                            const engine::DifferenceStatistics& s) {
  const dem::RasterInfo& tile = trip.window.tile;
  OrderedJson json{{"tile",
                    {{"name", tile.name},
                     {"post_spacing_m", tile.post_spacing_m},
                     {"quantisation_m", tile.quantisation_m},
                     {"posts", tile.lattice_level ? "copied" : "resampled"}}},
                   {"mode", mode_name(request.mode)},
                   {"center", {{"lat_deg", request.lat_deg}, {"lon_deg", request.lon_deg}}},
                   {"height_m", request.height_m}};
  if (request.mode == engine::RoundTripMode::camera) {
    json["footprint_ratio"] = request.footprint_ratio;
    json["pixel_footprint_m"] = trip.pixel_footprint_m;
    json["max_error_px"] = request.max_error_px;
  }
  json["window"] = window_json(trip.window);
  json["stations"] = trip.stations;
  json["counts"] = {{"posts", trip.window.size()}, {"compared", trip.compared},   {"hidden", trip.hidden},
                    {"missed", trip.missed},       {"elsewhere", trip.elsewhere}, {"voids", trip.voids}};
  json["difference"] = difference_json(trip, s);
  json["histogram"] = {{"from_m", -s.histogram.reach_m},
                       {"to_m", s.histogram.reach_m},
                       {"counts", s.histogram.counts},
                       {"below", s.histogram.below},
                       {"above", s.histogram.above}};
  json["quadrants"] = OrderedJson::array();
  for (const engine::Quadrant& q : s.quadrants) {
    json["quadrants"].push_back({{"name", q.name}});
    json["quadrants"].back().update(group_json(q.statistics));
  }
  json["slopes"] = OrderedJson::array();
  for (const engine::SlopeClass& c : s.slopes) {
    json["slopes"].push_back({{"from_deg", c.from_deg}, {"to_deg", c.to_deg}});
    json["slopes"].back().update(group_json(c.statistics));
  }
  json["software"] = fmt::format("selenograph {}", software_version());
  return json;
}

std::string length_text(double length_m) {
  if (std::isnan(length_m)) return "none";
  if (length_m == 0) return "0 m";
  constexpr std::pair<const char*, double> kUnits[] = {
      {"pm", 1e-12}, {"nm", 1e-9}, {"µm", 1e-6}, {"mm", 1e-3}, {"m", 1}};
  auto unit = kUnits[0];
  for (const auto& larger : kUnits)
    if (std::abs(length_m) >= 0.1 * larger.second) unit = larger;
  return fmt::format("{}{:.3g} {}", length_m < 0 ? "\u2212" : "", std::abs(length_m) / unit.second, unit.first);
}

dem::GeotiffGrid grid_of(const engine::PostWindow& w) {
  const Geographic first = w.place(0, 0);
  return {first.lat_deg, first.lon_deg, w.lat_step_deg(), w.lon_step_deg(), w.width, w.height};
}

}  // namespace selenograph::api
