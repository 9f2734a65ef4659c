// The schemas of what rays, landmarks and heights, and the catalogue, are answered with.
#include "api/document/openapi_parts.h"
#include "api/json/ranges.h"

namespace selenograph::api {

using namespace schema;

namespace {

void add_rays(OrderedJson& schemas, std::size_t most) {
  const OrderedJson hit =
      object("hit alone where nothing is hit",
             {{"hit", boolean("whether anything was hit")},
              {"object", number_or_null("index into the request's objects, if it has some; null: terrain")},
              {"rock", text("its id in POST /v1/features, if it is one of the detail's rocks")},
              {"range_m", number_or_null("from the origin, m")},
              {"position_m", vector("MOON_ME, m")},
              {"normal", vector("outward unit normal, MOON_ME")},
              {"lit", number_or_null("lit fraction, when a Sun was given")}},
             {"hit"});
  schemas["RaysAnswer"] = object("In the order of the request.", {{"rays", list(hit, most, "hits")}}, {"rays"});
}

void add_project(OrderedJson& schemas, std::size_t most) {
  const OrderedJson seen =
      object("",
             {{"x_px", number_or_null("column; null behind the camera and beyond the lens's field of view")},
              {"y_px", number_or_null("row; null as x_px is. With a shutter both, and range_m, are "
                                      "null where no row sees the point; where several do, they "
                                      "are of one of its places, in the image if it has any there")},
              {"range_m", number_or_null("from the camera, m")},
              {"time_s", number_or_null("with a shutter: when the row that sees it is exposed, "
                                        "line_time_s * y_px; null where none does")},
              {"height_m", number_or_null("that was used; null without data")},
              {"in_frame", boolean("in front of the camera and within the image")},
              {"visible", boolean("in_frame and nothing stands between")},
              {"lit", number_or_null("lit fraction, when a Sun was given")},
              {"reason", text("why a value is null: no data there; behind the camera; beyond the "
                              "lens's field of view, where its distortion folds and at 179 degrees "
                              "from a fisheye's boresight; seen by no row")}},
             {"x_px", "y_px", "range_m", "height_m", "in_frame", "visible"});
  schemas["ProjectAnswer"] =
      object("In the order of the request.", {{"points", list(seen, most, "landmarks")}}, {"points"});
}

void add_heights(OrderedJson& schemas, std::size_t most) {
  schemas["Height"] =
      object("Terrain at a place, by the triangles that frames are made of.",
             {{"lat_deg", number(kLatitude_deg, "as asked")},
              {"lon_deg", number({-180, 180, false, true}, "as asked, in [-180, 180)")},
              {"height_m", number_or_null("above the sphere of 1 737 400 m; null without data")},
              {"post_spacing_m", number_or_null("of the tile")},
              {"source", text("tile name")},
              {"filled", boolean("interpolated across a void")},
              {"blended", boolean("a mean of the source and the layer beneath it, near where they meet")},
              {"reason", text("why height_m is null")}},
             {"lat_deg", "lon_deg", "height_m"});
  schemas["HeightsAnswer"] =
      object("In the order of the request.", {{"points", list(ref("Height"), most, "places")}}, {"points"});
}

}  // namespace

void add_point_answers(OrderedJson& schemas, const Limits& limits) {
  const auto most = static_cast<std::size_t>(limits.max_rays);
  add_rays(schemas, most), add_project(schemas, most), add_heights(schemas, most);
}

void add_dataset_answers(OrderedJson& schemas) {
  const OrderedJson footprint = object("of the posts, degrees",
                                       {{"south_deg", number(kLatitude_deg, "")},
                                        {"north_deg", number(kLatitude_deg, "")},
                                        {"west_deg", number({-180, 180, false, true}, "")},
                                        {"east_deg", number({-180, 540}, "west_deg < east_deg <= west_deg + 360")}},
                                       {"south_deg", "north_deg", "west_deg", "east_deg"});
  const OrderedJson dataset = object(
      "One DEM tile.",
      {{"name", text("what `source` lists")},
       {"path", text("as opened")},
       {"format", text("e.g. PDS3 Kaguya")},
       {"projection", {{"type", "string"}, {"enum", {"geographic", "polar_stereographic"}}}},
       {"width", integer(1, 1LL << 31, "posts")},
       {"height", integer(1, 1LL << 31, "posts")},
       {"footprint", footprint},
       {"post_spacing_m", number(kAnyNumber, "along a meridian, m")},
       {"posts_per_degree", number(kAnyNumber, "along a meridian")},
       {"posts",
        {{"type", "string"},
         {"enum", {"copied", "resampled"}},
         {"description", "copied: the mesh's vertices are the posts"}}},
       {"datum", text("of the heights")},
       {"quantisation_m", number(kAnyNumber, "step between heights; 0: floating point")},
       {"gaps",
        {{"type", "object"}, {"description", "void_value: what stands for a missing post, in file units; null: none"}}},
       {"bytes", {{"type", "integer"}, {"description", "of the file with the posts"}}},
       {"offset_m", number(kAnyNumber, "added to its heights (--layer-offset), m")}},
      {"name", "path", "footprint", "post_spacing_m", "posts", "datum", "gaps", "bytes"});
  const OrderedJson problem =
      object("", {{"path", text("file or folder")}, {"what", text("what is wrong with it")}}, {"path", "what"});
  const OrderedJson side_layer =
      object("A file beside a DEM that holds no heights.",
             {{"path", text("file")}, {"kind", text("what it says about the heights")}}, {"path", "kind"});
  schemas["Datasets"] =
      object("The catalogue, from coarse to fine.",
             {{"fingerprint", text("changes when a file changes")},
              {"datasets", {{"type", "array"}, {"items", dataset}}},
              {"problems", {{"type", "array"}, {"items", problem}, {"description", "files that can't be used"}}},
              {"side_layers", {{"type", "array"}, {"items", side_layer}}},
              {"blend_posts", number(kAnyNumber, "width of the band between layers, in posts of the coarser one")}},
             {"fingerprint", "datasets", "problems"});
}

}  // namespace selenograph::api
