// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/lidar_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "api/json/ranges.h"
#include "api/requests/parts/array_rows.h"
#include "api/requests/parts/lidar_instrument_json.h"
#include "engine/lidar/pattern.h"

namespace selenograph::api {
namespace {

using engine::LidarRequest;

std::int64_t max_pulses(const Limits& limits) { return limits.max_rays; }

// "motion": constant rates, or poses at times; the other is empty.
struct LidarMotion {
  engine::Rates rates;
  std::vector<engine::PoseAtTime> poses;
  bool any() const { return !rates.none() || !poses.empty(); }
};

const Members<LidarMotion>& lidar_motion_members() {
  static const auto table = make_table<Members<LidarMotion>>(
      "LidarMotion",
      "Motion of the instrument during the scan: from `pose`, at time 0, at constant rates, or through poses, which "
      "replace `pose` and are interpolated like those of a shutter.",
      [](auto& m) {
        add_motion(m, "velocity, MOON_ME",
                   "at increasing times, the first not after the first pulse, the last not before the last pulse");
      });
  return *table;
}

const Members<engine::LidarCraters>& lidar_craters_members() {
  using engine::LidarCraters;
  static const auto table =
      make_table<Members<LidarCraters>>("LidarCraters", "Craters that are reported for beams.", [](auto& m) {
        m.add("smallest_m", &LidarCraters::smallest_m, Number{{0.25, 1e6}, "m"}, "least diameter");
        m.add("min_depth_over_diameter", &LidarCraters::least_depth, Number{kUnitInterval},
              "minimum present depth over diameter");
      });
  return *table;
}

// Returns the request's pattern, or the instrument's own; null if the request has single pulses or there is no pattern.
const engine::LidarPattern* pattern_of(const JsonReader& in, const LidarRequest& request) {
  if (!request.pulses.empty()) return nullptr;
  if (in.has("pattern")) return &request.pattern;
  return request.instrument.pattern ? &*request.instrument.pattern : nullptr;
}

// Counts the beams, reports too many of them, and copies the instrument's own pattern into the request if it is used.
void check_beams(const JsonReader& in, LidarQuery& query, const Limits& limits) {
  LidarRequest& request = query.request;
  const engine::LidarPattern* pattern = pattern_of(in, request);
  if (request.pulses.empty() && !pattern)
    return in.fail("pattern", "or \"pulses\" is required: the instrument has no pattern of its own");
  query.beams = pattern ? engine::LidarBeams::beams_of(*pattern) : request.pulses.size();
  const auto max_beams = static_cast<std::size_t>(limits.max_lidar_rays / request.instrument.sub_rays);
  if (query.beams > max_beams) {
    const std::string why =
        fmt::format("has {} beams of {} sub-rays; this service takes up to {} of them (--max-lidar-rays)", query.beams,
                    request.instrument.sub_rays, max_beams);
    // Point at the member that gave the beams, which may be the instrument's.
    if (!pattern)
      in.fail("pulses", why);
    else if (in.has("pattern") || !in.has("instrument"))
      in.fail("pattern", why);
    else
      in.at("instrument").fail("pattern", why);
    return;
  }
  if (pattern && pattern != &request.pattern) request.pattern = *pattern;
}

// Requires either "pose" or poses in "motion", and that the poses span the times of all pulses.
void check_pose_of_lidar(const JsonReader& in, LidarQuery& query) {
  const LidarRequest& request = query.request;
  const bool has_poses = !request.poses.empty();
  if (has_poses && in.has("pose"))
    in.fail("pose", "\"pose\" cannot be combined with \"motion.poses\", which take its place");
  if (!has_poses && !in.has("pose")) in.fail("pose", "is required");
  if (!has_poses || in.faults() > 0) return;
  // Times of the first and of the last pulse. A pattern's first pulse is at time 0.
  double first_s = 0, last_s = engine::last_time_s(request.pattern);
  if (!request.pulses.empty()) {
    const auto [first, last] = std::minmax_element(request.pulses.begin(), request.pulses.end(),
                                                   [](const auto& a, const auto& b) { return a.time_s < b.time_s; });
    first_s = first->time_s;
    last_s = last->time_s;
  }
  if (request.poses.front().time_s > first_s)
    in.at("motion").fail("poses",
                         fmt::format("the first is later than the first pulse, whose time is {:g} s", first_s));
  if (request.poses.back().time_s < last_s)
    in.at("motion").fail("poses", fmt::format("the last is earlier than the last pulse, whose time is {:g} s", last_s));
}

// Checks rules between members and completes the query: band, preset and objects of the scenery.
void check_lidar(const JsonReader& in, LidarQuery& query, const ReadContext& context) {
  if (in.faults() > 0) return;
  check_beams(in, query, context.limits);
  check_pose_of_lidar(in, query);
  if (in.faults() > 0) return;
  // The ground reflects in a narrow band around the laser's line.
  const double center_um = query.request.instrument.wavelength_um;
  query.request.scenery.band = engine::Band(center_um, center_um / 1000);
  resolve_preset(query.request.scenery, query.surface);
  for (const PlacedObject& placed : query.objects) query.request.scenery.objects.push_back(placed.object);
}

// Merges the request's instrument over the preset's (JSON merge patch). Faults of the preset's file are the operator's:
// they are reported as "asset_error" with the file's name.
Json with_lidar_preset(const Json& body, const ReadContext& context) {
  Findings findings;
  const JsonReader in(body, findings);
  const auto preset = Asset{&Assets::lidar, "preset", "lidars"}.read(in.at("instrument_preset"), context);
  findings.throw_if_any();
  Json instrument = *preset->content;
  instrument.erase("description");
  lidar_instrument_members().check_file(instrument, fmt::format("lidars/{}.json", preset->name), context);
  Json merged = body;
  merged.erase("instrument_preset");
  if (merged.contains("instrument")) instrument.merge_patch(merged["instrument"]);
  merged["instrument"] = instrument;
  return merged;
}

void add_lidar_members(Members<LidarQuery>& m) {
  m.add("instrument", nested(&LidarQuery::request, &LidarRequest::instrument), Object{lidar_instrument_members()},
        "the lidar; required unless `instrument_preset` is complete");
  m.add("instrument_preset", no_field<LidarQuery, std::string>(), Text{},
        "lidars/NAME.json of the assets folder: an instrument; members of `instrument` override it");
  m.any_of({"instrument", "instrument_preset"});
  m.add("pulses", nested(&LidarQuery::request, &LidarRequest::pulses),
        List{Object{lidar_pulse_members()}, 1, max_pulses},
        "single pulses in any order; as arrays (see the call) there may be more")
      .written_if([](const LidarQuery&) { return false; });
  m.add("pattern",
        Property{[](const LidarQuery& q) {
                   return q.request.pulses.empty() ? std::optional(q.request.pattern) : std::nullopt;
                 },
                 [](LidarQuery& q, const engine::LidarPattern& pattern) { q.request.pattern = pattern; }},
        Object{lidar_pattern_members()}, "a pattern of beams; left out: the instrument's own");
  m.excludes("pulses", {"pattern"}, "each says where the beams go");
  m.add("pose", nested(&LidarQuery::request, &LidarRequest::pose), Object{pose_members()},
        "position and attitude at the time 0; required unless `motion.poses` is given");
  m.add("motion",
        Property{[](const LidarQuery& q) {
                   const LidarMotion motion{q.request.rates, q.request.poses};
                   return motion.any() ? std::optional(motion) : std::nullopt;
                 },
                 [](LidarQuery& q, const LidarMotion& motion) {
                   q.request.rates = motion.rates;
                   q.request.poses = motion.poses;
                 }},
        Object{lidar_motion_members()}, "motion during the scan; left out: none");
  m.add("seed", nested(&LidarQuery::request, &LidarRequest::seed), Integer{0, kMaxSeed},
        "identifies the instrument's noise");
  m.add("scan", nested(&LidarQuery::request, &LidarRequest::scan), Integer{0, kMaxSeed},
        "number of the scan: each has its own noise");
  m.add("craters", nested(&LidarQuery::request, &LidarRequest::craters), FlagOrObject{lidar_craters_members()},
        "ground truth of the detail's craters: `crater` in the answer; true: with the defaults; left out: none");
  add_ground(m);
  m.add("objects", &LidarQuery::objects, List{Object{object_members()}, 1, kMaxObjects}, "as in a frame")
      .written_if([](const LidarQuery& q) { return !q.objects.empty(); });
  m.check(check_lidar);
}

// Converts the arrays "direction" and "time_s" to pulses; without "time_s" all are at time 0.
std::vector<engine::LidarPulse> pulses_of(const NpzArrays& arrays, Findings& findings) {
  const auto directions = rows_of(arrays, "direction", {3}, findings);
  if (!directions) return {};
  std::vector<engine::LidarPulse> pulses(directions->size());
  const auto times = arrays.find("time_s");
  const std::size_t time_count = times == arrays.end() ? 0 : times->second.numbers.size();
  if (times != arrays.end() && time_count != 1 && time_count != pulses.size())
    findings.add("/time_s", fmt::format("must be one number, or one for each of the {} directions", pulses.size()));
  for (std::size_t i = 0; i < pulses.size() && findings.empty(); ++i) {
    const auto unit = direction_of(directions->vector(i));
    if (!unit) findings.add(fmt::format("/direction/{}", i), "is not a direction: finite numbers, not all zero");
    const double time_s = time_count == 0 ? 0 : times->second.numbers[time_count == 1 ? 0 : i];
    if (!(std::abs(time_s) <= 1e6)) findings.add(fmt::format("/time_s/{}", i), "is not within 1e6 s");
    if (unit) pulses[i] = {time_s, *unit};
  }
  return pulses;
}

}  // namespace

const Members<LidarQuery>& lidar_members() {
  static const auto table = make_table<Members<LidarQuery>>(
      "LidarRequest", "A lidar, its pose and the beams of a scan.", [](auto& m) { add_lidar_members(m); });
  return *table;
}

LidarQuery read_lidar(const Json& body, const NpzArrays& arrays, const Limits& limits, const Assets& assets,
                      const StopToken& stop, const GroundHeights& ground) {
  ReadContext context{limits, assets, stop, {}};
  context.ground_height = ground_height_of(body, ground, context);
  const bool has_preset = body.is_object() && body.contains("instrument_preset");
  Json merged = has_preset ? with_lidar_preset(body, context) : body;
  Findings findings;
  std::vector<engine::LidarPulse> pulses;
  reject_unknown_arrays(arrays, {"direction", "time_s"}, findings);
  if (arrays.contains("direction")) {
    if (merged.is_object() && (merged.contains("pulses") || merged.contains("pattern")))
      findings.add("/direction", "cannot be combined with \"pulses\" or \"pattern\"");
    pulses = pulses_of(arrays, findings);
    findings.throw_if_any();
    // Put one pulse in place of the array, so that the other members are checked as in a request with "pulses".
    if (merged.is_object()) merged["pulses"] = {{{"direction", {0, 0, 1}}}};
  } else if (arrays.contains("time_s")) {
    findings.add("/time_s", "needs direction");
  }
  findings.throw_if_any();
  LidarQuery query = lidar_members().read_body(merged, context);
  if (!pulses.empty()) {
    query.request.pulses = std::move(pulses);
    // Check again with all pulses: the first check saw the stand-in.
    const JsonReader in(merged, findings);
    check_beams(in, query, limits);
    check_pose_of_lidar(in, query);
    findings.throw_if_any();
  }
  return query;
}

std::vector<std::size_t> shape_of(const LidarQuery& query) {
  const engine::LidarPattern& p = query.request.pattern;
  // A serpentine scan runs every other row backwards: its beams are not in the order of an image.
  const bool is_image = query.request.pulses.empty() && !p.serpentine &&
                        (p.scan == engine::LidarScan::flash || p.scan == engine::LidarScan::raster);
  if (!is_image) return {query.beams};
  std::vector<std::size_t> shape{static_cast<std::size_t>(p.rows), static_cast<std::size_t>(p.columns)};
  if (p.repeats > 1) shape.insert(shape.begin(), static_cast<std::size_t>(p.repeats));
  return shape;
}

}  // namespace selenograph::api
