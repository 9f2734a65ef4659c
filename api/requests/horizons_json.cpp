// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/horizons_json.h"

#include <fmt/format.h>

#include "api/json/ranges.h"
#include "api/requests/parts/pose_json.h"
#include "dem/base/error.h"
#include "engine/sky/ephemeris.h"

namespace selenograph::api {
namespace {

using engine::HorizonOptions;

constexpr int kMinAzimuths = 8, kMaxAzimuths = 3600;
constexpr std::int64_t kMaxEpochs = 100000;

std::int64_t max_places(const Limits& limits) { return limits.max_rays; }

const auto farthest_km = Property{[](const HorizonOptions& o) { return std::optional(o.farthest_m / 1e3); },
                                  [](HorizonOptions& o, double km) { o.farthest_m = km * 1e3; }};

const Members<HorizonOptions>& horizon_members() {
  static const auto table = make_table<
      Members<HorizonOptions>>("Horizon", "What of the ground around an eye makes its horizon.", [](auto& m) {
    m.add("azimuths", &HorizonOptions::azimuths, Integer{kMinAzimuths, kMaxAzimuths},
          "number of azimuths, in equal steps clockwise from north");
    m.add("height_above_ground_m", &HorizonOptions::height_above_ground_m, Number{{0, 1e4}, "m"}, "height of the eye");
    m.add("farthest_km", farthest_km, Number{{1, 300}, "km"},
          "distance along the sphere; farther ground is ignored, so horizons formed by it come out too low (at 84.8 S, "
          "by up to 2 degrees with 20 km instead of 200)");
  });
  return *table;
}

// Adds the rows that both requests have.
template <typename Query>
void add_places(Members<Query>& m) {
  m.add("map", &Query::area, Object{area_members()}, "projection, extent and pixels: an eye at each pixel");
  m.add("places", &Query::places, List{Object{place_members()}, 1, max_places}, "places of the eyes, instead of a map")
      .written_if([](const Query& q) { return !q.places.empty(); });
  m.add("detail", &Query::detail, DetailName{}, kDetailMeaning);
  add_map_error(m);
  m.add("horizon", &Query::horizon, Object{horizon_members()}, "the horizons");
  m.exactly_one({"map", "places"});
}

void set_grid(const JsonReader& in, HorizonsQuery& query, const ReadContext& context) {
  if (!in.good() || !query.area) return;
  if (const auto grid = grid_of(in.at("map"), *query.area, context.limits)) query.grid = *grid;
}

// Returns the epochs from one to another; reports faults.
std::vector<std::string> epochs_of(const JsonReader& in, const IlluminationQuery& query) {
  const auto read = [&](const char* member, const std::string& utc) {
    const auto epoch = epoch_of(utc);
    if (!epoch) in.fail(member, "must be an epoch like 2026-11-20T00:00:00Z, in whole seconds");
    return epoch;
  };
  const auto from = read("from_utc", query.from_utc), to = read("to_utc", query.to_utc);
  if (!from || !to) return {};
  const std::chrono::seconds step(static_cast<std::int64_t>(query.step_s));
  if (static_cast<double>(step.count()) != query.step_s) in.fail("step_s", "must be whole seconds");
  if (*to < *from) in.fail("to_utc", "is before from_utc");
  if (!in.good()) return {};
  if ((*to - *from) / step >= kMaxEpochs) {
    in.fail("step_s", fmt::format("makes more than {} epochs", kMaxEpochs));
    return {};
  }
  std::vector<std::string> epochs;
  for (Epoch epoch = *from; epoch <= *to; epoch += step) epochs.push_back(utc_of(epoch));
  for (const auto& [member, utc] : {std::pair("from_utc", epochs.front()), std::pair("to_utc", epochs.back())}) {
    try {
      engine::sun_at(utc);
    } catch (const ImpossibleRequest& e) {
      in.fail(member, e.what());
    }
  }
  return epochs;
}

}  // namespace

const Members<HorizonsQuery>& horizons_members() {
  static const auto table = make_table<Members<HorizonsQuery>>(
      "HorizonsRequest", "Elevations of the horizon around the pixels of a map, or around places.", [](auto& m) {
        add_places(m);
        m.check([](const JsonReader& in, HorizonsQuery& query, const ReadContext& context) {
          set_grid(in, query, context);
        });
      });
  return *table;
}

const Members<IlluminationQuery>& illumination_members() {
  static const auto table = make_table<Members<IlluminationQuery>>(
      "IlluminationRequest", "Sun and Earth above the horizons of a map's pixels, or of places, over a time span.",
      [](auto& m) {
        add_places(m);
        m.add("from_utc", &IlluminationQuery::from_utc, Text{}, "first epoch, like 2026-11-20T00:00:00Z").required();
        m.add("to_utc", &IlluminationQuery::to_utc, Text{},
              "end of the span; the last epoch is the last step before or at it")
            .required();
        m.add("step_s", &IlluminationQuery::step_s, Number{{1, 1e7}, "s"}, "from epoch to epoch: whole seconds");
        m.check([](const JsonReader& in, IlluminationQuery& query, const ReadContext& context) {
          set_grid(in, query, context);
          if (!in.good()) return;
          query.epochs = epochs_of(in, query);
          if (query.epochs.size() * query.places.size() > static_cast<std::size_t>(context.limits.max_map_pixels))
            in.fail("places", fmt::format("{} places at {} epochs are more than {} values: ask for fewer, or for a map",
                                          query.places.size(), query.epochs.size(), context.limits.max_map_pixels));
        });
      });
  return *table;
}

HorizonsQuery read_horizons(const Json& body, const Limits& limits, const Assets& assets, const StopToken& stop) {
  return horizons_members().read_body(body, {limits, assets, stop});
}

IlluminationQuery read_illumination(const Json& body, const Limits& limits, const Assets& assets,
                                    const StopToken& stop) {
  return illumination_members().read_body(body, {limits, assets, stop});
}

OrderedJson resolved_json(const HorizonsQuery& query) { return horizons_members().write(query); }
OrderedJson resolved_json(const IlluminationQuery& query) { return illumination_members().write(query); }

}  // namespace selenograph::api
