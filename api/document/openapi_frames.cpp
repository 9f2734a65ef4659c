// The schemas of what POST /v1/frames answers besides arrays.
#include "api/document/openapi_parts.h"
#include "api/json/ranges.h"
#include "api/requests/frame_json.h"

namespace selenograph::api {

using namespace schema;

namespace {

OrderedJson view() {
  const OrderedJson place = object(
      "", {{"lat_deg", number(kLatitude_deg, "")}, {"lon_deg", number(kLongitude_deg, "")}}, {"lat_deg", "lon_deg"});
  return object(
      "The view in words of the ground. null: where no terrain is met, or an object stands before it; of the boresight "
      "also where it is outside the image. Absent without terrain",
      {{"lat_deg", number_or_null("where the boresight meets the terrain")},
       {"lon_deg", number_or_null("the same")},
       {"height_m", number_or_null("the same")},
       {"off_nadir_deg", number(kAnyNumber, "angle between the boresight and the direction of the Moon's centre")},
       {"up_azimuth_deg", number_or_null("compass azimuth there of what is up in the image")},
       {"corners", list({{"anyOf", {place, {{"type", "null"}}}}}, 4,
                        "what the corner pixels' centres see: upper left, upper right, lower right, lower left")},
       {"sun", object("The Sun at that place; absent where the request has none.",
                      {{"azimuth_deg", number_or_null("clockwise from north")},
                       {"elevation_deg", number_or_null("above the sphere's horizon")}},
                      {"azimuth_deg", "elevation_deg"})},
       {"post_px",
        number_or_null("how many pixels wide the post spacing of the DEM is there, across the line of sight")}},
      {"lat_deg", "lon_deg", "height_m", "off_nadir_deg", "up_azimuth_deg", "corners", "post_px"});
}

// What the pixels are made of, and how well.
OrderedJson metadata_members() {
  const OrderedJson source =
      object("", {{"name", text("DEM tile")}, {"version", text("hash of path, size and modification time")}},
             {"name", "version"});
  OrderedJson members = {
      {"software", {{"type", "object"}, {"description", "name and version"}}},
      {"content_hash", text("the ETag without quotes")},
      {"request", with(ref("FrameRequest"), "description",
                       "The request as understood: pose in MOON_ME and opencv axes, intrinsics, Sun vector. A valid "
                       "request itself")},
      {"reflectance", {{"type", "object"}, {"description", "normalisation: the equation as printed in the paper"}}},
      {"solar_irradiance",
       {{"type", "object"}, {"description", "value_w_m2 at the Moon after 1/r^2, its band and source"}}},
      {"full_scale_radiance_w_m2_sr", number(kAnyNumber, "that `image` was made with")},
      {"radiance_terms", list(text("direct, indirect, scattered, emitted, thermal_path"), 5,
                              "components of radiance that were evaluated: SENSOR++ eq. (1)")},
      {"point_spread",
       {{"type", "object"},
        {"description",
         "of an image by a sensor: margin_px that was rendered around it (the shares of pixels below count "
         "it), captured_fraction of a point's light within the kernel (\"airy\": 12 rings, 32 pixels at most; the "
         "rest is spread evenly over the kernel)"}}},
      {"motion",
       {{"type", "object"},
        {"description",
         "of an exposure in motion: samples, the moments that it is averaged over; longest_streak_px, "
         "about how far the ground or an object moves in the image meanwhile"}}},
      {"visibility", with(words(kVisibilities, "that the frame was made with"), "enum", {"zbuffer", "raytrace"})}};
  members.update(OrderedJson{
      {"lod_error_px", number(kAnyNumber, "level-of-detail error bound actually reached, pixels")},
      {"lod_error_m", number(kAnyNumber, "the same in metres")},
      {"shadow_error_px",
       number(kAnyNumber,
              "bound on how far the mesh's error displaces a shadow's edge on level ground, pixels. The edge's own: "
              "read from the pixels of two frames it may be displaced by up to a pixel's diagonal more")},
      {"detail_error_px", number(kAnyNumber, "of lod_error_px, what the detail adds")},
      {"post_spacing_m", {{"type", "object"}, {"description", "min and max over the mesh in view"}}},
      {"triangles", {{"type", "integer"}, {"description", "of the scene"}}},
      {"hit_fraction", number(kUnitInterval, "share of pixels that see the Moon or an object")},
      {"maps", {{"type", "array"}, {"description", "of each map of the ground: name and version"}}},
      {"object_fraction", number(kUnitInterval, "share of pixels that see an object")},
      {"rocks", object("of a detail that has rocks",
                       {{"number", number({0, 1e9, true, false}, "in view, or whose shadow may be")},
                        {"least_px", number(kAnyNumber,
                                            "diameter in pixels from which on they are shown: 2 max_error_px, or "
                                            "more where they would be too many")},
                        {"fraction", number(kUnitInterval, "share of pixels that see one")}},
                       {"number", "least_px", "fraction"})},
      {"objects",
       {{"type", "array"}, {"description", "of each object: mesh, version (hash of its content), triangles, parts"}}},
      {"filled_fraction", number(kUnitInterval, "share of pixels on posts filled by interpolation")},
      {"blended_fraction", number(kUnitInterval, "share of pixels on posts that are a mean of two layers")},
      {"missing_fraction", number(kUnitInterval, "share of pixels that look at the Moon where there is no data")},
      {"view", view()},
      {"sources", {{"type", "array"}, {"items", source}, {"description", "what the product `source` indexes"}}},
      {"sources_omitted", {{"type", "integer"}, {"description", "in the header only: so many did not fit"}}},
      {"metadata_at", text("in the header only: path of the metadata with what did not fit")},
      {"warnings", {{"type", "array"}, {"items", {{"type", "string"}}}}}});
  return members;
}

}  // namespace

void add_frame_answers(OrderedJson& schemas) {
  schemas["FrameMetadata"] = object(
      "What is said about a frame besides its pixels: meta.json in an .npz, the attribute `selenograph` of images, the "
      "header Selenograph-Meta elsewhere. The same request gives the same text.",
      metadata_members(),
      {"software", "content_hash", "request", "lod_error_px", "lod_error_m", "sources", "warnings"});
  schemas["MetadataElsewhere"] =
      object("In the header, where all metadata do not fit.",
             {{"content_hash", text("the ETag without quotes")}, {"metadata_at", text("path of the metadata")}},
             {"content_hash", "metadata_at"});
}

}  // namespace selenograph::api
