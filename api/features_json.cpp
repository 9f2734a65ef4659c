#include "api/features_json.h"

#include <fmt/format.h>

#include <cmath>
#include <iterator>

#include "api/assets.h"

namespace selenograph::api {
namespace {

using dem::CraterFeature;

constexpr Range kDiameter_m{0, 1e7, true, false};
// Cells of the law that are looked through, over the most craters that are answered: laws may be sparse.
constexpr double kCellsPerCrater = 40;

constexpr CraterColumn kColumns[] = {
    {"lat_deg", "planetocentric latitude of the centre", [](const CraterFeature& f) { return f.place.lat_deg; }},
    {"lon_deg", "east longitude of the centre, in [-180, 180)", [](const CraterFeature& f) { return f.place.lon_deg; }},
    {"height_m",
     "of the terrain without detail at the centre, above the sphere of 1 737 400 m: of the ground before all impacts. "
     "POST /v1/heights with `detail` has that of the floor",
     [](const CraterFeature& f) { return f.place.height_m; }},
    {"diameter_m",
     "from rim to rim when it was fresh. With age the highest ring moves outward and sinks: it is 1.2 of these wide "
     "when 60 % of the depth is left, and 1.5 when a third is",
     [](const CraterFeature& f) { return f.crater.diameter_m; }},
    {"depth_m", "from the highest ring to the floor, today; of the crater alone",
     [](const CraterFeature& f) { return f.crater.depth_m; }},
    {"age_Ma", "since the impact", [](const CraterFeature& f) { return f.crater.age_Ma; }},
    {"rim_share",
     "of the rim, 0 to 1, what the terrain shows: not where the DEM's posts are finer or missing, nor where other "
     "craters of its octave of diameters change it by more than a quarter of its depth",
     [](const CraterFeature& f) { return f.rim_share; }}};

// What there are too many of, and from where on there are not.
void check_number(const JsonReader& in, const FeaturesQuery& query, const Limits& limits) {
  const dem::CraterField& field = query.detail.content->craters();
  const dem::Footprint region = query.region();
  const double most = limits.max_rays, least_m = query.least_m();
  const auto fits = [&](double diameter_m) {
    return dem::expected_craters(field, region, diameter_m) <= most &&
           dem::cells_of_craters(field, region, diameter_m) <= kCellsPerCrater * most;
  };
  if (fits(least_m)) return;
  double enough_m = least_m;
  while (enough_m < field.law().largest_m && !fits(enough_m)) enough_m *= 1.05;
  // Of two digits, rounded up.
  const double unit = std::pow(10, std::floor(std::log10(enough_m)) - 1);
  enough_m = std::ceil(enough_m / unit) * unit;
  const std::string instead = enough_m < field.law().largest_m && fits(enough_m)
                                  ? fmt::format(", or smallest_m of {:g} or more", enough_m)
                                  : std::string();
  const double expected = dem::expected_craters(field, region, least_m);
  in.fail("region",
          expected > most
              ? fmt::format("holds some {:.3g} craters of at least {:g} m, at most {} are answered: ask for a smaller "
                            "region{}",
                            expected, least_m, limits.max_rays, instead)
              : fmt::format("is too large to be searched for craters of at least {:g} m: ask for a smaller one{}",
                            least_m, instead));
}

}  // namespace

dem::Footprint FeaturesQuery::region() const { return footprint_of(bounds); }

double FeaturesQuery::most() const {
  const double mean = dem::expected_craters(detail.content->craters(), region(), least_m());
  return mean + 10 * std::sqrt(mean) + 100;
}

const Members<FeaturesQuery>& features_members() {
  static const auto table = made<Members<
      FeaturesQuery>>("FeaturesRequest", "Craters of a detail that the terrain shows in a region.", [](auto& m) {
    m.add("detail", &FeaturesQuery::detail, Asset{&Assets::detail, "detail", "details"},
          "name of details/NAME.json in the operator's assets folder")
        .required();
    m.add("region", &FeaturesQuery::bounds, Object{bounds_members()}, "that holds the craters' centres").required();
    m.add("smallest_m", &FeaturesQuery::smallest_m, Number{kDiameter_m, "m"}, "least diameter; left out: the preset's");
    m.check([](const JsonReader& in, FeaturesQuery& query, const ReadContext& context) {
      if (in.good() && query.detail.content) check_number(in, query, context.limits);
    });
  });
  return *table;
}

FeaturesQuery read_features(const Json& body, const Limits& limits, const Assets& assets, const StopToken& stop) {
  Findings findings;
  auto value = features_members().read(JsonReader(body, findings), {limits, assets, stop});
  findings.throw_if_any();
  return std::move(*value);
}

std::span<const CraterColumn> crater_columns() { return kColumns; }

std::string id_text(const CraterFeature& feature) { return fmt::format("{:016x}", feature.crater.id); }

std::string features_json(const FeaturesQuery& query, std::span<const CraterFeature> craters) {
  const dem::Footprint region = query.region();
  std::string text;
  auto out = std::back_inserter(text);
  fmt::format_to(
      out,
      R"({{"detail":{},"region":{{"south_deg":{},"north_deg":{},"west_deg":{},"east_deg":{}}},"smallest_m":{},"craters":[)",
      detail_metadata(query.detail.name, *query.detail.content).dump(), region.south_deg, region.north_deg,
      region.west_deg, region.east_deg, query.least_m());
  for (std::size_t i = 0; i < craters.size(); ++i) {
    fmt::format_to(out, R"({}{{"id":"{}")", i == 0 ? "\n" : ",\n", id_text(craters[i]));
    for (const CraterColumn& column : kColumns)
      fmt::format_to(out, R"(,"{}":{})", column.name, column.value(craters[i]));
    text += '}';
  }
  return text + "]}\n";
}

std::string features_csv(std::span<const CraterFeature> craters) {
  std::string text = "id";
  for (const CraterColumn& column : kColumns) (text += ',') += column.name;
  text += '\n';
  for (const CraterFeature& crater : craters) {
    text += id_text(crater);
    for (const CraterColumn& column : kColumns) fmt::format_to(std::back_inserter(text), ",{}", column.value(crater));
    text += '\n';
  }
  return text;
}

}  // namespace selenograph::api
