// Tables of an answer's members (api/schema/answers.h). A row is a.add(name in JSON, JSON Schema, function that returns
// the value, condition); a member without a condition is always written.
#include "api/answers/round_trip_answer.h"

#include <fmt/format.h>

#include <cmath>

#include "api/answers/metadata.h"
#include "api/json/ranges.h"
#include "api/message/version.h"

namespace selenograph::api {
namespace {

using engine::DifferenceStatistics;

// Adds the statistics of a group of posts, which group(source) returns.
template <typename Source, typename Group>
void add_group(Answer<Source>& a, Group group) {
  using namespace schema;
  // Returns the function that reads a field of the group's statistics.
  const auto of = [group](auto engine::GroupStatistics::*field) {
    return [group, field](const Source& s) { return group(s).*field; };
  };
  using engine::GroupStatistics;
  a.add("posts", integer(0, 1LL << 62, "compared"), of(&GroupStatistics::posts));
  a.add("mean_m", number_or_null("extracted minus original"), of(&GroupStatistics::mean_m));
  a.add("mean_absolute_m", number_or_null("mean of the differences' sizes"), of(&GroupStatistics::mean_absolute_m));
  a.add("rms_m", number_or_null("root of the mean square"), of(&GroupStatistics::rms_m));
  a.add("standard_error_m", number_or_null("of the mean, from its scatter over squares of 32 x 32 posts or more"),
        of(&GroupStatistics::standard_error_m));
  a.add("z", number_or_null("mean over standard error: above 3 in size by chance once in 370"),
        of(&GroupStatistics::z));
}

// Returns the post with the largest difference; null if no post was compared.
OrderedJson worst_json(const engine::RoundTrip& trip, const DifferenceStatistics& s) {
  if (s.worst_row < 0) return nullptr;
  const Geographic g = trip.window.place(s.worst_row, s.worst_col);
  const auto original = trip.original_m[trip.window.index(s.worst_row, s.worst_col)];
  return {{"difference_m", s.worst_m},
          {"lat_deg", g.lat_deg},
          {"lon_deg", g.lon_deg},
          {"original_m", static_cast<double>(original)}};
}

void add_percentiles(Answer<DifferenceStatistics>& a, const char* name,
                     std::vector<engine::Percentile> DifferenceStatistics::*field) {
  using namespace schema;
  static const auto percentile = make_answer<engine::Percentile>("", [](auto& p) {
    p.add("percent", number({0, 100}, ""), [](const auto& s) { return s.percent; });
    p.add("value_m", number_or_null(""), [](const auto& s) { return s.value_m; });
  });
  a.add(name, array(percentile.schema()),
        [field](const DifferenceStatistics& s) { return percentile.write_all(s.*field); });
}

const Answer<DifferenceStatistics>& difference_answer() {
  static const auto answer = make_answer<DifferenceStatistics>("All posts.", [](Answer<DifferenceStatistics>& a) {
    add_group(a, [](const DifferenceStatistics& s) { return s.all; });
    for (const auto& [name, field] : {std::pair("median_m", &DifferenceStatistics::median_m),
                                      std::pair("median_absolute_m", &DifferenceStatistics::median_absolute_m),
                                      std::pair("standard_deviation_m", &DifferenceStatistics::standard_deviation_m)})
      a.add(name, schema::number_or_null(""), [field = field](const DifferenceStatistics& s) { return s.*field; });
    add_percentiles(a, "percentiles", &DifferenceStatistics::percentiles);
    add_percentiles(a, "absolute_percentiles", &DifferenceStatistics::absolute_percentiles);
    a.describe("worst", {{"type", {"object", "null"}},
                         {"description", "difference_m, lat_deg, lon_deg, original_m of the largest"}});
  });
  return answer;
}

const Answer<engine::Quadrant>& quadrant_answer() {
  static const auto answer = make_answer<engine::Quadrant>("Of the window.", [](Answer<engine::Quadrant>& a) {
    a.add("name", schema::text("NW, NE, SW, SE"), [](const engine::Quadrant& q) { return q.name; });
    add_group(a, [](const engine::Quadrant& q) { return q.statistics; });
  });
  return answer;
}

const Answer<engine::SlopeClass>& slope_answer() {
  using engine::SlopeClass;
  static const auto answer = make_answer<SlopeClass>("Posts on ground of such slopes.", [](Answer<SlopeClass>& a) {
    a.add("from_deg", schema::number(kAnyNumber, ""), [](const SlopeClass& c) { return c.from_deg; });
    a.add("to_deg", schema::number(kAnyNumber, ""), [](const SlopeClass& c) { return c.to_deg; });
    add_group(a, [](const SlopeClass& c) { return c.statistics; });
  });
  return answer;
}

OrderedJson window_json(const engine::PostWindow& w) {
  const Geographic first = w.place(0, 0), last = w.place(w.height - 1, w.width - 1);
  return {{"rows", w.height},           {"columns", w.width},        {"south_deg", last.lat_deg},
          {"north_deg", first.lat_deg}, {"west_deg", first.lon_deg}, {"east_deg", last.lon_deg}};
}

void add_request(Answer<RoundTripSource>& a) {
  using namespace schema;
  const auto by_camera = [](const RoundTripSource& s) { return s.request.mode == engine::RoundTripMode::camera; };
  a.add("tile", free_object("name, post_spacing_m, quantisation_m, posts"), [](const RoundTripSource& s) {
    const dem::RasterInfo& tile = s.trip.window.tile;
    return OrderedJson{{"name", tile.name},
                       {"post_spacing_m", tile.post_spacing_m},
                       {"quantisation_m", tile.quantisation_m},
                       {"posts", tile.lattice_level ? "copied" : "resampled"}};
  });
  a.add("mode", words(kRoundTripModes, ""), [](const RoundTripSource& s) { return mode_name(s.request.mode); });
  a.add("center", ref("Place"), [](const RoundTripSource& s) {
    return OrderedJson{{"lat_deg", s.request.lat_deg}, {"lon_deg", s.request.lon_deg}};
  });
  a.add("height_m", number(kStationHeight_m, "height of the cameras above the ground"),
        [](const RoundTripSource& s) { return s.request.height_m; });
  a.add(
      "footprint_ratio", number(kFootprintRatio, "as asked; mode camera"),
      [](const RoundTripSource& s) { return s.request.footprint_ratio; }, by_camera);
  a.add(
      "pixel_footprint_m", number(kAnyNumber, "straight below a camera; mode camera"),
      [](const RoundTripSource& s) { return s.trip.pixel_footprint_m; }, by_camera);
  a.add(
      "max_error_px", number(kMaxError_px, "as asked; mode camera"),
      [](const RoundTripSource& s) { return s.request.max_error_px; }, by_camera);
}

void add_counts(Answer<RoundTripSource>& a) {
  using namespace schema;
  a.add("window",
        free_object("rows, columns, and the bounds of the posts; west_deg above east_deg: across 180 degrees"),
        [](const RoundTripSource& s) { return window_json(s.trip.window); });
  a.add("stations", integer(0, 1LL << 62, "camera positions"),
        [](const RoundTripSource& s) { return s.trip.stations; });
  a.add("counts",
        free_object("posts = compared + hidden (behind nearer terrain) + missed (no hit: next to voids, beyond the "
                    "last tile; by frames, next to a pole) + elsewhere (under a finer tile) + voids"),
        [](const RoundTripSource& s) {
          const engine::RoundTrip& trip = s.trip;
          return OrderedJson{{"posts", trip.window.size()}, {"compared", trip.compared},   {"hidden", trip.hidden},
                             {"missed", trip.missed},       {"elsewhere", trip.elsewhere}, {"voids", trip.voids}};
        });
}

}  // namespace

const Answer<RoundTripSource>& round_trip_answer() {
  using namespace schema;
  static const auto answer =
      make_answer<RoundTripSource>("Extracted minus original heights.", [](Answer<RoundTripSource>& a) {
        add_request(a);
        add_counts(a);
        a.add("difference", difference_answer().schema(), [](const RoundTripSource& s) {
          OrderedJson json = difference_answer().write(s.statistics);
          json["worst"] = worst_json(s.trip, s.statistics);
          return json;
        });
        a.add("histogram",
              free_object(
                  "counts of posts in classes of equal width between from_m and to_m; posts below and above them"),
              [](const RoundTripSource& s) {
                const auto& h = s.statistics.histogram;
                return OrderedJson{{"from_m", -h.reach_m},
                                   {"to_m", h.reach_m},
                                   {"counts", h.counts},
                                   {"below", h.below},
                                   {"above", h.above}};
              });
        a.add("quadrants", array(quadrant_answer().schema()),
              [](const RoundTripSource& s) { return quadrant_answer().write_all(s.statistics.quadrants); });
        a.add("slopes", array(slope_answer().schema()),
              [](const RoundTripSource& s) { return slope_answer().write_all(s.statistics.slopes); });
        a.add("software", text("name and version"),
              [](const RoundTripSource&) { return fmt::format("selenograph {}", software_version()); });
      });
  return answer;
}

std::string length_text(double length_m) {
  if (std::isnan(length_m)) return "none";
  if (length_m == 0) return "0 m";
  constexpr std::pair<const char*, double> kUnits[] = {
      {"pm", 1e-12}, {"nm", 1e-9}, {"µm", 1e-6}, {"mm", 1e-3}, {"m", 1}};
  // Take the largest unit of which the length has at least a tenth: 0.1 to 100 of it, as the units are 1000 apart.
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
