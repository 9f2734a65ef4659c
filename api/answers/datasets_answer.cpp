// Tables of an answer's members (api/schema/answers.h). A row is a.add(name in JSON, JSON Schema, function that returns
// the value, condition); a member without a condition is always written.
#include "api/answers/datasets_answer.h"

#include <fmt/format.h>

#include "api/json/ranges.h"
#include "api/message/json_text.h"

namespace selenograph::api {
namespace {

// A tile of the catalogue, and the offset added to its heights, m.
struct DatasetSource {
  const dem::RasterInfo& raster;
  double offset_m;
};

void add_footprint(auto& a) {
  using namespace schema;
  a.add(
      "footprint",
      object("of the posts, degrees",
             {{"south_deg", number(kLatitude_deg, "")},
              {"north_deg", number(kLatitude_deg, "")},
              {"west_deg", number(from(-180).below(180), "")},
              {"east_deg", number({-180, 540}, "west_deg < east_deg <= west_deg + 360")}},
             {"south_deg", "north_deg", "west_deg", "east_deg"}),
      [](const DatasetSource& s) {
        const dem::Footprint& f = s.raster.footprint;
        return OrderedJson{
            {"south_deg", f.south_deg}, {"north_deg", f.north_deg}, {"west_deg", f.west_deg}, {"east_deg", f.east_deg}};
      });
}

const Answer<DatasetSource>& dataset_answer() {
  using S = DatasetSource;
  using dem::RasterInfo;
  using namespace schema;
  static const auto answer = make_answer<S>("One DEM tile.", [](auto& a) {
    // Returns the function that reads a field of the tile's RasterInfo.
    const auto raster_field = [](auto RasterInfo::*field) { return [field](const S& s) { return s.raster.*field; }; };
    a.add("name", text("what `source` lists"), raster_field(&RasterInfo::name));
    a.add("path", text("as opened"), raster_field(&RasterInfo::path));
    a.add("format", text("e.g. PDS3 Kaguya"), raster_field(&RasterInfo::format));
    a.add("synthetic", boolean("generated terrain (the sample terrain), not the Moon's"),
          raster_field(&RasterInfo::synthetic));
    a.add("projection",
          {{"type", "string"},
           {"enum",
            {"geographic", "polar_stereographic", "stereographic", "orthographic", "mercator", "transverse_mercator"}}},
          [](const S& s) { return dem::name_of(s.raster.projection()); });
    a.add("width", integer(1, 1LL << 31, "posts"), raster_field(&RasterInfo::width));
    a.add("height", integer(1, 1LL << 31, "posts"), raster_field(&RasterInfo::height));
    add_footprint(a);
    a.add("post_spacing_m", number(kAnyNumber, "along a meridian, m"), raster_field(&RasterInfo::post_spacing_m));
    a.add("posts_per_degree", number(kAnyNumber, "along a meridian"), raster_field(&RasterInfo::posts_per_degree));
    a.add("posts",
          {{"type", "string"},
           {"enum", {"copied", "resampled"}},
           {"description", "copied: the mesh's vertices are the posts"}},
          [](const S& s) { return s.raster.lattice_level ? "copied" : "resampled"; });
    a.add("datum", text("of the heights"), raster_field(&RasterInfo::datum));
    a.add("quantisation_m", number(kAnyNumber, "step between heights; 0: floating point"),
          raster_field(&RasterInfo::quantisation_m));
    a.add("gaps", free_object("void_value: value of a missing post, in file units; null: none"), [](const S& s) {
      return OrderedJson{{"void_value", s.raster.void_value ? OrderedJson(*s.raster.void_value) : OrderedJson()}};
    });
    a.add("bytes", {{"type", "integer"}, {"description", "of the file with the posts"}},
          raster_field(&RasterInfo::bytes));
    a.add("offset_m", number(kAnyNumber, "added to its heights (--layer-offset), m"),
          [](const S& s) { return s.offset_m; });
  });
  return answer;
}

OrderedJson datasets_json(const dem::Catalogue& catalogue) {
  OrderedJson datasets = OrderedJson::array();
  for (std::size_t i = 0; i < catalogue.rasters().size(); ++i)
    datasets.push_back(dataset_answer().write({catalogue.rasters()[i], catalogue.offset_m(static_cast<int>(i))}));
  return datasets;
}

}  // namespace

const Answer<dem::Catalogue>& datasets_answer() {
  using S = dem::Catalogue;
  using namespace schema;
  static const auto answer = make_answer<S>("The catalogue, from coarse to fine.", [](auto& a) {
    a.add("fingerprint", text("changes when a file changes"),
          [](const S& s) { return fmt::format("{:016x}", s.fingerprint()); });
    a.add("datasets", array(dataset_answer().schema()), datasets_json);
    a.add(
        "problems",
        array(object("", {{"path", text("file or folder")}, {"what", text("what is wrong with it")}}, {"path", "what"}),
              "files that cannot be used, or not all of them"),
        [](const S& s) {
          OrderedJson list = OrderedJson::array();
          for (const auto& problem : s.problems()) list.push_back({{"path", problem.path}, {"what", problem.what}});
          return list;
        });
    a.add("side_layers",
          array(object("A raster of another quantity than heights, which is not used.",
                       {{"path", text("file")}, {"kind", text("its quantity, e.g. slopes")}}, {"path", "kind"})),
          [](const S& s) {
            OrderedJson list = OrderedJson::array();
            for (const auto& side : s.side_layers()) list.push_back({{"path", side.path}, {"kind", side.kind}});
            return list;
          });
    a.add("blend_posts",
          number(kAnyNumber, "width of the band in which a layer is bent to meet a finer one, in its posts"),
          [](const S& s) { return s.joins().blend_posts; });
  });
  return answer;
}

std::string datasets_text(const dem::Catalogue& catalogue) { return json_line(datasets_answer().write(catalogue)); }

}  // namespace selenograph::api
