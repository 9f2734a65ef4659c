// GET /v1/datasets.
#include <fmt/format.h>

#include "api/endpoints/endpoint.h"

namespace selenograph::api {
namespace {

using OrderedJson = nlohmann::ordered_json;

const char* projection_name(dem::Projection projection) {
  return projection == dem::Projection::geographic ? "geographic" : "polar_stereographic";
}

OrderedJson dataset_json(const dem::RasterInfo& raster, double offset_m) {
  const dem::Footprint& f = raster.footprint;
  OrderedJson json{
      {"name", raster.name},
      {"path", raster.path},
      {"format", raster.format},
      {"projection", projection_name(raster.projection())},
      {"width", raster.width},
      {"height", raster.height},
      {"footprint",
       {{"south_deg", f.south_deg}, {"north_deg", f.north_deg}, {"west_deg", f.west_deg}, {"east_deg", f.east_deg}}},
      {"post_spacing_m", raster.post_spacing_m},
      {"posts_per_degree", raster.posts_per_degree},
      {"posts", raster.lattice_level ? "copied" : "resampled"},
      {"datum", raster.datum},
      {"quantisation_m", raster.quantisation_m}};
  json["gaps"] = {{"void_value", raster.void_value ? OrderedJson(*raster.void_value) : OrderedJson(nullptr)}};
  json["bytes"] = raster.bytes;
  json["offset_m"] = offset_m;
  return json;
}

}  // namespace

std::string datasets_text(const dem::Catalogue& catalogue) {
  OrderedJson datasets = OrderedJson::array(), problems = OrderedJson::array(), side_layers = OrderedJson::array();
  for (std::size_t i = 0; i < catalogue.rasters().size(); ++i)
    datasets.push_back(dataset_json(catalogue.rasters()[i], catalogue.offset_m(static_cast<int>(i))));
  for (const dem::SideLayer& side : catalogue.side_layers())
    side_layers.push_back({{"path", side.path}, {"kind", side.kind}});
  for (const dem::CatalogueProblem& problem : catalogue.problems()) {
    problems.push_back({{"path", problem.path}, {"what", problem.what}});
  }
  const OrderedJson json{{"fingerprint", fmt::format("{:016x}", catalogue.fingerprint())},
                         {"datasets", std::move(datasets)},
                         {"problems", std::move(problems)},
                         {"side_layers", std::move(side_layers)},
                         {"blend_posts", catalogue.joins().blend_posts}};
  // File names need not be UTF-8.
  return json.dump(-1, ' ', false, OrderedJson::error_handler_t::replace) + "\n";
}

}  // namespace selenograph::api
