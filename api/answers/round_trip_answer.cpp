#include "api/answers/round_trip_answer.h"

#include <fmt/format.h>

#include <cmath>

#include "api/answers/metadata.h"

namespace selenograph::api {
namespace {

using OrderedJson = nlohmann::ordered_json;

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
