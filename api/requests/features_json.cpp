// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/features_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "api/assets/assets.h"
#include "api/json/ranges.h"
#include "api/message/json_text.h"
#include "dem/detail/footprints.h"
#include "engine/cache/render_context.h"

namespace selenograph::api {
namespace {

using dem::CraterFeature;
using dem::RockFeature;

constexpr std::pair<std::string_view, FeatureKind> kKinds[] = {{"craters", FeatureKind::craters},
                                                               {"rocks", FeatureKind::rocks}};

// From below the smallest rock of any preset to beyond the largest crater.
constexpr Range kDiameter_m{0.01, 1e7};
// Upper bound of the cells searched per crater that may be listed. It bounds the search where a law has few craters per
// cell.
constexpr double kCellsPerCrater = 40;

constexpr FeatureColumn<CraterFeature> kCraterColumns[] = {
    {"lat_deg", "planetocentric latitude of the centre", [](const CraterFeature& f) { return f.location.lat_deg; }},
    {"lon_deg", "east longitude of the centre, in [-180, 180)",
     [](const CraterFeature& f) { return f.location.lon_deg; }},
    {"height_m",
     "height of the terrain without detail at the centre, above the sphere of 1 737 400 m: of the ground before all "
     "impacts. POST /v1/heights with `detail` gives the height of the floor",
     [](const CraterFeature& f) { return f.location.height_m; }},
    {"diameter_m",
     "diameter of the fresh crater, from rim to rim. With age the highest ring moves outward and sinks: its diameter "
     "is 1.2 times this when 60 % of the depth is left, and 1.5 times when a third is left",
     [](const CraterFeature& f) { return f.crater.diameter_m; }},
    {"depth_m",
     "present depth from the highest ring to the floor, of the crater alone. The part that the DEM's posts contain is "
     "subtracted; it is largest for craters as wide as two posts. On the border of two layers of the DEM: the depth "
     "that the terrain shows",
     [](const CraterFeature& f) { return f.depth_m; }},
    {"depth_over_diameter", "depth_m over diameter_m", [](const CraterFeature& f) { return f.depth_over_diameter(); }},
    {"visibility",
     "depth_m over the roughness of the ground at its size: the root mean square, over places of the detail's ground, "
     "of the difference that a depth is, the mean height on a circle of diameter_m minus that of its middle. Above 1.6 "
     "a crater is hardly taken for chance (5 % of places are, if differences are normally distributed). At most 1000",
     [](const CraterFeature& f) { return f.visibility; }},
    {"age_Ma", "time since the impact", [](const CraterFeature& f) { return f.crater.age_Ma; }},
    {"rim_share",
     "of the rim, 0 to 1, what the terrain shows: not where the DEM's posts are finer or missing, nor where other "
     "craters of its octave of diameters change it by more than a quarter of its depth",
     [](const CraterFeature& f) { return f.rim_share; }},
    {"brightness",
     "factor of the ground's albedo at the rim, averaged over azimuths, by this crater alone: above 1 while it is "
     "young. "
     "Of what craters of its octave add on average, frames subtract the mean",
     [](const CraterFeature& f) { return f.brightness; }}};

constexpr FeatureColumn<RockFeature> kRockColumns[] = {
    {"lat_deg", "planetocentric latitude of the middle", [](const RockFeature& f) { return f.location.lat_deg; }},
    {"lon_deg", "east longitude of the middle, in [-180, 180)",
     [](const RockFeature& f) { return f.location.lon_deg; }},
    {"height_m", "of the ground that it stands on, with detail, above the sphere of 1 737 400 m",
     [](const RockFeature& f) { return f.location.height_m; }},
    {"diameter_m",
     "its largest extent along the ground, of which it is 0.2 to 0.9 high, 0.55 on average. Partly buried, it covers "
     "0.59 "
     "of a circle of that diameter, seen from above: as much as one of 0.77 diameters",
     [](const RockFeature& f) { return f.rock.diameter_m; }},
    {"age_Ma", "since it lies there", [](const RockFeature& f) { return f.rock.age_Ma; }},
    {"brightness", "factor of its albedo over the constant albedo of the ground",
     [](const RockFeature& f) { return f.rock.brightness; }}};

// Size range of the detail's craters or rocks, as its preset defines them.
struct Population {
  std::string_view name;
  double smallest_m, largest_m;
  int smallest_octave, largest_octave;  // octaves of diameter that the detail has cells for
};
// Returns the size range of the kind of features that the query asks for.
Population population_of(const FeaturesQuery& query) {
  const dem::Detail& detail = *query.detail.content;
  const auto population = [](std::string_view name, const auto& features) {
    return Population{name, features.law().smallest_m, features.law().largest_m, features.smallest_octave(),
                      features.largest_octave()};
  };
  return query.kind == FeatureKind::rocks ? population("rocks", detail.rocks())
                                          : population("craters", detail.craters());
}

// Returns the mean number of craters of at least this diameter in the region, or an upper bound of the rocks.
double expected_count(const FeaturesQuery& query, double diameter_m) {
  return query.kind == FeatureKind::rocks
             ? dem::max_expected_rocks(query.detail.content->rocks(), query.region(), diameter_m)
             : dem::expected_craters(query.detail.content->craters(), query.region(), diameter_m);
}
// Returns the number of cells that a search for diameters from `diameter_m` visits.
double cell_count(const FeaturesQuery& query, double diameter_m) {
  const Population population = population_of(query);
  return dem::cells_of(population.smallest_octave, population.largest_octave, query.region(), diameter_m);
}

// Appends the features to `text` as JSON, one object a line. (A JSON library would take several times the memory.)
template <typename Feature>
void add_json(std::span<const Feature> features, std::span<const FeatureColumn<Feature>> columns, const StopToken& stop,
              std::string& text) {
  for (std::size_t i = 0; i < features.size(); ++i) {
    stop.check();
    fmt::format_to(std::back_inserter(text), R"({}{{"id":"{}")", i == 0 ? "\n" : ",\n",
                   id_text(features[i].member().id));
    for (const auto& column : columns)
      fmt::format_to(std::back_inserter(text), R"(,"{}":{})", column.name, column.value(features[i]));
    text += '}';
  }
}

// Returns a line with the columns' names, and one for each feature.
template <typename Feature>
std::string csv_of(std::span<const Feature> features, std::span<const FeatureColumn<Feature>> columns,
                   const StopToken& stop) {
  std::string text = "id";
  for (const auto& column : columns) {
    text += ',';
    text += column.name;
  }
  text += '\n';
  for (const Feature& feature : features) {
    stop.check();
    text += id_text(feature.member().id);
    for (const auto& column : columns) fmt::format_to(std::back_inserter(text), ",{}", column.value(feature));
    text += '\n';
  }
  return text;
}

// Reports a region with more features than are answered, or with too many cells to search. The text suggests a minimum
// diameter with which the same region can be answered.
void check_count(const JsonReader& in, const FeaturesQuery& query, const Limits& limits) {
  const Population population = population_of(query);
  const double max_count = limits.max_rays, min_diameter_m = query.min_diameter_m();
  // Returns true if a search for features from this diameter can be answered.
  const auto fits = [&](double diameter_m) {
    return expected_count(query, diameter_m) <= max_count &&
           cell_count(query, diameter_m) <= kCellsPerCrater * max_count;
  };
  if (fits(min_diameter_m)) return;
  // Raise the diameter in steps of 5 % over the preset's range. The range bounds the number of steps: a request cannot
  // make this loop long.
  double suggested_m = std::max(min_diameter_m, population.smallest_m);
  while (suggested_m < population.largest_m && !fits(suggested_m)) suggested_m *= 1.05;
  // Round up to two significant digits.
  const double second_digit_m = std::pow(10, std::floor(std::log10(suggested_m)) - 1);
  suggested_m = std::ceil(suggested_m / second_digit_m) * second_digit_m;
  const std::string instead = suggested_m < population.largest_m && fits(suggested_m)
                                  ? fmt::format(", or smallest_m of {:g} or more", suggested_m)
                                  : std::string();
  const double feature_count = expected_count(query, min_diameter_m);
  in.fail(
      "region",
      feature_count > max_count
          ? fmt::format("holds {} {:.3g} {} of at least {:g} m, at most {} are answered: ask for a smaller region{}",
                        query.kind == FeatureKind::rocks ? "up to" : "some", feature_count, population.name,
                        min_diameter_m, limits.max_rays, instead)
          : fmt::format("is too large to be searched for {} of at least {:g} m: ask for a smaller one{}",
                        population.name, min_diameter_m, instead));
}

}  // namespace

dem::Footprint FeaturesQuery::region() const { return footprint_of(bounds); }

double FeaturesQuery::min_diameter_m() const { return smallest_m.value_or(population_of(*this).smallest_m); }

std::size_t FeaturesQuery::bytes() const {
  // A feature takes its record while it is evaluated, plus its text. A cell takes its share of the list of sub-regions,
  // which are a few cells wide.
  constexpr double kBytesPerFeature = 1000, kBytesPerCell = 16;
  // Counts are Poisson distributed: ten standard deviations above the mean are never exceeded.
  const double mean = expected_count(*this, min_diameter_m()), max_count = mean + 10 * std::sqrt(mean) + 100;
  const std::size_t survey_bytes = kind == FeatureKind::rocks ? dem::RockSurvey::kKeptBytes : 0;
  return static_cast<std::size_t>(kBytesPerFeature * max_count + kBytesPerCell * cell_count(*this, min_diameter_m())) +
         survey_bytes;
}

const Members<FeaturesQuery>& features_members() {
  static const auto table = make_table<Members<FeaturesQuery>>(
      "FeaturesRequest", "Craters of a detail that the terrain shows in a region, or its rocks.", [](auto& m) {
        m.add("detail", &FeaturesQuery::detail, Asset{&Assets::detail, "detail", "details"},
              "name of details/NAME.json in the operator's assets folder")
            .required();
        m.add("kind", &FeaturesQuery::kind, Word{kKinds}, "what is listed");
        m.add("region", &FeaturesQuery::bounds, Object{bounds_members()}, "region of their centres").required();
        m.add("smallest_m", &FeaturesQuery::smallest_m, Number{kDiameter_m, "m"},
              "minimum diameter; left out: the preset's");
        m.add("min_depth_over_diameter", &FeaturesQuery::min_depth_over_diameter, Number{kUnitInterval},
              "minimum `depth_over_diameter` of craters; 0: all, down to those no longer recognisable as craters");
        m.check([](const JsonReader& in, FeaturesQuery& query, const ReadContext& context) {
          if (query.kind == FeatureKind::rocks && in.has("min_depth_over_diameter"))
            in.fail("min_depth_over_diameter", "is of craters: rocks have no depth");
          if (in.good() && query.detail.content) check_count(in, query, context.limits);
        });
      });
  return *table;
}

FeaturesQuery read_features(const Json& body, const Limits& limits, const Assets& assets, const StopToken& stop) {
  return features_members().read_body(body, {limits, assets, stop});
}

std::span<const FeatureColumn<CraterFeature>> crater_columns() { return kCraterColumns; }
std::span<const FeatureColumn<RockFeature>> rock_columns() { return kRockColumns; }

std::string id_text(std::uint64_t id) { return fmt::format("{:016x}", id); }

FeatureList::FeatureList(const FeaturesQuery& query, const engine::Renderer& renderer, const StopToken& stop)
    : query_(query), stop_(stop) {
  if (query.kind == FeatureKind::rocks)
    rocks_ = renderer.query(query.detail.content, stop, [&](const engine::RenderContext& context) {
      return dem::RockSurvey(context.terrain).rocks_in(query.region(), query.min_diameter_m(), stop);
    });
  else
    craters_ = renderer.query(query.detail.content, stop, [&](const engine::RenderContext& context) {
      const dem::CraterSurvey survey(context.terrain, context.cache.roughness(context.terrain, stop));
      return survey.craters_in(query.region(), query.min_diameter_m(), query.min_depth_over_diameter, stop);
    });
}

std::string FeatureList::json() const {
  const dem::Footprint region = query_.region();
  std::string text =
      fmt::format(R"({{"detail":{},"region":{{"south_deg":{},"north_deg":{},"west_deg":{},"east_deg":{}}},)"
                  R"("smallest_m":{},{}"{}":[)",
                  json_text(detail_metadata(query_.detail.name, *query_.detail.content)), region.south_deg,
                  region.north_deg, region.west_deg, region.east_deg, query_.min_diameter_m(),
                  query_.kind == FeatureKind::craters
                      ? fmt::format(R"("min_depth_over_diameter":{},)", query_.min_depth_over_diameter)
                      : "",
                  population_of(query_).name);
  if (query_.kind == FeatureKind::rocks)
    add_json<RockFeature>(rocks_, kRockColumns, stop_, text);
  else
    add_json<CraterFeature>(craters_, kCraterColumns, stop_, text);
  return text + "]}\n";
}

std::string FeatureList::csv() const {
  return query_.kind == FeatureKind::rocks ? csv_of<RockFeature>(rocks_, kRockColumns, stop_)
                                           : csv_of<CraterFeature>(craters_, kCraterColumns, stop_);
}

}  // namespace selenograph::api
