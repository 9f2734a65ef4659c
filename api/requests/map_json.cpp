// A map's grid lies on the plane of its projection, whose origin is the projection's centre:
//
//   (west_m, north_m) +-----------------+   row 0
//                     |     y ^         |
//                     |       |         |   pixels of gsd_m x gsd_m, values at their centres
//                     |       o--> x    |
//                     +-----------------+   row height - 1
//
// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/map_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "api/json/ranges.h"
#include "api/requests/parts/band_json.h"
#include "api/requests/parts/detail_json.h"
#include "api/requests/parts/products_json.h"
#include "dem/base/error.h"
#include "engine/hazard/hazard_map.h"

namespace selenograph::api {
namespace {

using dem::MapProjection;
using engine::FrameRequest;
using engine::MapRequest;

constexpr std::pair<std::string_view, MapProjection> kProjections[] = {
    {"equirectangular", MapProjection::equirectangular},
    {"polar_stereographic", MapProjection::stereographic},
    {"orthographic", MapProjection::orthographic}};

}  // namespace

// --- projection and extent

dem::Footprint footprint_of(const MapBounds& bounds) {
  // A western edge at 360 degrees is the meridian 0.
  const double west_deg = bounds.west_deg < 360 ? bounds.west_deg : 0;
  dem::Footprint footprint{bounds.south_deg, bounds.north_deg, west_deg, bounds.east_deg};
  while (footprint.east_deg <= footprint.west_deg) footprint.east_deg += 360;
  return footprint;
}

const Members<MapBounds>& bounds_members() {
  static const auto members = make_table<Members<MapBounds>>(
      "MapBounds",
      "Outer edges of a map or region. If west_deg is larger than east_deg, the region crosses 180 degrees.",
      [](auto& m) {
        m.add("south_deg", &MapBounds::south_deg, Number{kLatitude_deg, "deg"}, "latitude").required();
        m.add("north_deg", &MapBounds::north_deg, Number{kLatitude_deg, "deg"}, "latitude").required();
        m.add("west_deg", &MapBounds::west_deg, Number{kLongitude_deg, "deg"}, "longitude, east-positive").required();
        m.add("east_deg", &MapBounds::east_deg, Number{kLongitude_deg, "deg"}, "longitude, east-positive").required();
        m.check([](const JsonReader& in, MapBounds& bounds, const ReadContext&) {
          if (in.has("south_deg") && in.has("north_deg") && !(bounds.south_deg < bounds.north_deg))
            in.fail("north_deg", "must be greater than south_deg");
          if (in.has("west_deg") && in.has("east_deg") && bounds.west_deg == bounds.east_deg)
            in.fail("east_deg", "must differ from west_deg");
          if (bounds.east_deg - bounds.west_deg > 360) in.fail("east_deg", "is more than 360 degrees east of west_deg");
        });
      });
  return *members;
}

namespace {

constexpr Range kMapSide_m = above(0).to(2e7), kGsd_m{0.01, 1e6}, kStandardParallel_deg{-89, 89};
constexpr int kMaxSide_px = 65500;  // the longest side of a PNG that common libraries read

const Members<MapWindow>& window_members() {
  static const auto members = make_table<Members<MapWindow>>(
      "MapWindow", "A rectangle of a map's pixels, as in the answer to the entire map.", [](auto& m) {
        m.add("x_px", &MapWindow::x_px, Integer{0, kMaxSide_px}, "columns of the map west of it").required();
        m.add("y_px", &MapWindow::y_px, Integer{0, kMaxSide_px}, "rows of the map north of it").required();
        m.add("width_px", &MapWindow::width_px, Integer{1, kMaxSide_px}, "its columns").required();
        m.add("height_px", &MapWindow::height_px, Integer{1, kMaxSide_px}, "its rows").required();
      });
  return *members;
}

}  // namespace

const Members<MapArea>& area_members() {
  static const auto members = make_table<Members<MapArea>>(
      "MapArea",
      "Projection and extent of a map, on the sphere of 1 737 400 m. Pixels are squares on the projection's plane and "
      "hold the values at their centres; row 0 is the northernmost.",
      [](auto& m) {
        m.add(
             "projection", &MapArea::projection, Word{kProjections},
             "equirectangular; polar_stereographic: about the pole of the centre's hemisphere, longitude 0 downward in "
             "the north and upward in the south, true to scale at the pole; orthographic: about the centre")
            .required();
        m.set_model("projection");
        m.add("bounds", &MapArea::bounds, Object{bounds_members()},
              "the area, from its north-west corner; the last row and column may extend beyond it. The standard "
              "parallel is the equator, the central meridian 0, or 180 for a map that crosses it")
            .only_for({"equirectangular"});
        m.add("center", &MapArea::center, Object{place_members()},
              "centre of a map of width_m x height_m; for equirectangular maps its latitude is the standard parallel");
        m.add("width_m", &MapArea::width_m, Number{kMapSide_m, "m"}, "on the projection's plane, to whole pixels");
        m.add("height_m", &MapArea::height_m, Number{kMapSide_m, "m"}, "on the projection's plane, to whole pixels");
        m.add("gsd_m", &MapArea::gsd_m, Number{kGsd_m, "m"}, "side of a pixel where the projection is true to scale")
            .required();
        m.add("standard_parallel_deg", &MapArea::standard_parallel_deg, Number{kStandardParallel_deg, "deg"},
              "latitude where a pixel is gsd_m wide; left out: 0 with bounds, the centre's with center")
            .only_for({"equirectangular"});
        m.add("window", &MapArea::window, Object{window_members()},
              "answer only these pixels of the map: a tile of a map that is too large for one answer");
        m.exactly_one({"bounds", "center"});
        m.excludes("bounds", {"width_m", "height_m"}, "they say the size");
        m.needs("center", {"width_m"});
        m.needs("center", {"height_m"});
      });
  return *members;
}

namespace {

// Returns the number of whole pixels that cover a length. An excess below 1e-6 pixels is rounding, not another pixel.
double pixels_that_cover(double length_m, double gsd_m) {
  constexpr double kRounding = 1e-6;
  return std::max(1.0, std::ceil(length_m / gsd_m - kRounding));
}

// Edges on the projection's plane, and size in whole pixels: doubles, since sizes are checked only later.
struct Extent {
  double west_m, north_m, width_px, height_px;
};

// Returns the extent of an equirectangular map by its bounds, and sets the plane's central meridian.
Extent place_by_bounds(const MapBounds& b, double gsd_m, dem::MapPlane& plane) {
  const auto [south_deg, north_deg, west_deg, east_deg] = footprint_of(b);
  // Take a central meridian from which no edge is farther than 180 degrees.
  plane.lon_deg = west_deg >= -180 && east_deg <= 180 ? 0
                  : west_deg >= 0 && east_deg <= 360  ? 180
                                                      : (west_deg + east_deg) / 2;
  const double metres_per_degree = kMetresPerDegree * std::cos(plane.standard_parallel_deg * kRadiansPerDegree);
  return {(west_deg - plane.lon_deg) * metres_per_degree, north_deg * kMetresPerDegree,
          pixels_that_cover((east_deg - west_deg) * metres_per_degree, gsd_m),
          pixels_that_cover((north_deg - south_deg) * kMetresPerDegree, gsd_m)};
}

// Returns the extent of a map about its centre, in whole pixels, and sets the plane's origin.
Extent place_about_center(const MapArea& area, dem::MapPlane& plane) {
  const Geographic& center = *area.center;
  if (plane.projection == MapProjection::stereographic) {
    plane.lat_deg = center.lat_deg >= 0 ? 90 : -90;
  } else {
    plane.lon_deg = wrap_lon_deg(center.lon_deg);
    if (plane.projection == MapProjection::orthographic) plane.lat_deg = center.lat_deg;
  }
  // Only an orthographic plane has its origin at the map's centre: the others have theirs at a pole or on the equator.
  const bool at_origin = plane.projection == MapProjection::orthographic;
  const dem::MapPoint middle =
      at_origin ? dem::MapPoint() : dem::MapTransform(plane).project(center.lat_deg, center.lon_deg).value();
  const double width_px = std::max(1.0, std::round(*area.width_m / area.gsd_m)),
               height_px = std::max(1.0, std::round(*area.height_m / area.gsd_m));
  return {middle.x_m - width_px * area.gsd_m / 2, middle.y_m + height_px * area.gsd_m / 2, width_px, height_px};
}

}  // namespace

std::optional<dem::MapGrid> grid_of(const JsonReader& in, const MapArea& area, const Limits& limits) {
  dem::MapGrid grid;
  grid.plane.projection = area.projection;
  grid.gsd_m = area.gsd_m;
  if (area.projection == MapProjection::equirectangular)
    grid.plane.standard_parallel_deg = area.standard_parallel_deg.value_or(area.bounds ? 0 : area.center->lat_deg);
  // A centre's latitude alone can be out of range: a given parallel was checked when it was read.
  if (!kStandardParallel_deg.contains(grid.plane.standard_parallel_deg)) {
    in.at("center").fail(
        "lat_deg", fmt::format("is not a valid standard parallel of an equirectangular map, which is at most {:g} "
                               "degrees from the equator: give standard_parallel_deg, or ask for "
                               "polar_stereographic",
                               kStandardParallel_deg.max));
    return std::nullopt;
  }
  const Extent extent =
      area.bounds ? place_by_bounds(*area.bounds, area.gsd_m, grid.plane) : place_about_center(area, grid.plane);
  const MapWindow entire_map{0, 0, static_cast<int>(std::min<double>(extent.width_px, kMaxSide_px)),
                             static_cast<int>(std::min<double>(extent.height_px, kMaxSide_px))};
  const MapWindow window = area.window.value_or(entire_map);
  const auto max_pixels = static_cast<double>(limits.max_map_pixels);
  const bool has_long_side = extent.width_px > kMaxSide_px || extent.height_px > kMaxSide_px;
  const bool counts_window = area.window && !has_long_side;
  const double width_px = counts_window ? window.width_px : extent.width_px,
               height_px = counts_window ? window.height_px : extent.height_px;
  if (has_long_side || width_px * height_px > max_pixels) {
    in.fail("gsd_m",
            fmt::format("the map would have {:.0f} x {:.0f} pixels, more than the {:.0f} allowed, or the {} along a "
                        "side",
                        width_px, height_px, max_pixels, kMaxSide_px));
    return std::nullopt;
  }
  if (window.x_px + window.width_px > entire_map.width_px || window.y_px + window.height_px > entire_map.height_px) {
    in.fail("window", fmt::format("is beyond the map's {} x {} pixels", entire_map.width_px, entire_map.height_px));
    return std::nullopt;
  }
  grid.west_m = extent.west_m + window.x_px * area.gsd_m;
  grid.north_m = extent.north_m - window.y_px * area.gsd_m;
  grid.width = window.width_px;
  grid.height = window.height_px;
  return grid;
}

dem::MapGrid read_grid(const Json& body, const Limits& limits) {
  Findings findings;
  const JsonReader root(body, findings);
  const JsonReader in = root.at("map");  // refers to its parent
  const Assets no_assets;
  const auto area = area_members().read(in, {limits, no_assets, {}, {}});
  const auto grid = area && in.good() ? grid_of(in, *area, limits) : std::nullopt;
  findings.throw_if_any();
  return *grid;
}

// --- viewer

namespace {

struct MapView {
  Vec3 direction = Vec3::unit_z();
};
const Members<MapView>& view_members() {
  static const auto members = make_table<Members<MapView>>(
      "MapView", "A viewer so far away that all pixels are seen from the same direction.", [](auto& m) {
        m.add("direction", &MapView::direction, Vector{kAnyNumber}, "toward the viewer, MOON_ME; any length but zero")
            .required();
        m.resolve([](const JsonReader& in, const MapView& view, const ReadContext&) -> std::optional<MapView> {
          const std::optional<Vec3> direction = direction_member(in, view.direction);
          return direction ? std::optional(MapView{*direction}) : std::nullopt;
        });
      });
  return *members;
}

// "view": the word "nadir", or an object with a direction; empty for nadir.
struct NadirOr {
  using Value = std::optional<MapView>;
  static constexpr Constant kNadir{"nadir"};
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const {
    if (in.value().is_string()) return kNadir.read(in, context) ? std::optional<Value>(Value()) : std::nullopt;
    const auto view = view_members().read(in, context);
    return view ? std::optional<Value>(view) : std::nullopt;
  }
  OrderedJson write(const Value& value) const { return value ? view_members().write(*value) : kNadir.write({}); }
  OrderedJson schema(const Limits& limits) const {
    return {{"anyOf", {kNadir.schema(limits), reference_to(view_members())}}};
  }
  std::vector<const MemberTable*> objects() const { return {&view_members()}; }
};

// --- accuracy, footprint, hazard

const Members<engine::Accuracy>& map_accuracy_members() {
  using engine::Accuracy;
  static const auto members = make_table<
      Members<Accuracy>>("MapAccuracy", "Accuracy against speed. A pixel is gsd_m wide.", [](auto& m) {
    m.add("max_error_px", &Accuracy::max_error_px, Number{kMaxError_px, "px"},
          "upper bound on the mesh's vertical error; posts are at most twice as far apart; 0: the finest posts");
    m.add("max_shadow_error_px", &Accuracy::max_shadow_error_px, Number{{0, 1e6}, "px"},
          "limit on the displacement of shadow edges on level ground by the mesh's error");
    m.add("max_detail_error_px", &Accuracy::max_detail_error_px, Number{{0, 1e6}, "px"}, max_detail_error_meaning());
  });
  return *members;
}

constexpr std::pair<std::string_view, engine::LanderFootprint::Shape> kShapes[] = {
    {"disc", engine::LanderFootprint::Shape::disc},
    {"square", engine::LanderFootprint::Shape::square},
    {"legs", engine::LanderFootprint::Shape::legs}};

const Members<engine::LanderFootprint>& footprint_members() {
  using engine::LanderFootprint;
  static const auto members = make_table<Members<LanderFootprint>>(
      "LanderFootprint", "The ground that a lander covers, around each pixel: the pixels whose centres are in it.",
      [](auto& m) {
        m.add("shape", &LanderFootprint::shape, Word{kShapes},
              "disc; square, along the meridian; legs: the disc, but the plane of `slope` is fitted only to the ground "
              "at the legs' ends, each the nearest pixel");
        m.set_model("shape");
        m.add("diameter_m", &LanderFootprint::diameter_m, Number{above(0).to(1e6), "m"},
              "diameter of the disc or of the circle through the legs' ends; side of the square. 3 to 256 pixels of "
              "`gsd_m`; a warning counts the pixels without a plane where the map is stretched")
            .required();
        m.add("legs", &LanderFootprint::legs, Integer{3, 12}, "number of legs, at equal angles").only_for({"legs"});
        m.add("azimuth_deg", &LanderFootprint::azimuth_deg, Number{{-360, 360}, "deg"},
              "azimuth of the first leg, clockwise from north")
            .only_for({"legs"});
      });
  return *members;
}

const Members<engine::HazardLimits>& hazard_members() {
  using engine::HazardLimits;
  static const auto members = make_table<Members<HazardLimits>>(
      "HazardLimits", "Ground whose footprint exceeds one of these is a hazard; omitted limits are not checked.",
      [](auto& m) {
        m.add("max_slope_deg", &HazardLimits::slope_deg, Number{{0, 90}, "deg"}, "maximum of `slope`");
        m.add("max_roughness_m", &HazardLimits::roughness_m, Number{{0, 1e4}, "m"}, "maximum of `roughness`");
        m.add("max_rock_height_m", &HazardLimits::rock_height_m, Number{{0, 1e4}, "m"},
              "maximum of `rock_height` at any pixel in the footprint. Requires `rocks`");
        m.add("max_rock_cover", &HazardLimits::rock_cover, Number{kUnitInterval},
              "maximum of `rock_cover`. Requires `rocks`");
        m.any_of({"max_slope_deg", "max_roughness_m", "max_rock_height_m", "max_rock_cover"});
      });
  return *members;
}

const auto view_field =
    Property{[](const MapQuery& q) {
               const auto& toward = q.request.toward_viewer;
               return std::optional<NadirOr::Value>(toward ? NadirOr::Value(MapView{*toward}) : NadirOr::Value());
             },
             [](MapQuery& q, const NadirOr::Value& view) {
               if (view) q.request.toward_viewer = view->direction;
             }};

// Checks that products of a lander's footprint come with one, that limits on rocks come with rocks, and that the
// footprint has enough pixels to fit a plane and not too many.
void check_footprint(const JsonReader& in, const MapQuery& query) {
  const engine::MapRequest& request = query.request;
  // Reports that `member` is missing if one of `products` is requested; `product_names` names these in the error.
  const auto require_member = [&](engine::ProductSet products, const char* member, const char* product_names) {
    if (request.products & products && !in.has(member))
      in.fail(member, fmt::format("is required for {}", product_names));
  };
  // These products describe the ground in a lander's footprint around each pixel. "hazard" also needs the limits whose
  // violations it marks, in the member of the same name.
  require_member(engine::kRoughness | engine::kRockCover | engine::kHazard, "footprint",
                 "the products \"roughness\", \"rock_cover\" and \"hazard\"");
  require_member(engine::kHazard, "hazard", "the product \"hazard\"");
  // Rocks are part of a detail, and are drawn from above only: their products, and limits on them, need both.
  if (request.products & (engine::kRockHeight | engine::kRockCover) && !request.rocks)
    in.fail("rocks", "must be true for the products \"rock_height\" and \"rock_cover\"");
  if (request.rocks && !in.has("detail")) in.fail("rocks", "requires \"detail\": the rocks are its");
  if (request.rocks && request.toward_viewer)
    in.fail("view", "cannot be combined with \"rocks\", which are seen from straight above");
  if (in.has("hazard") && (request.hazard.rock_height_m || request.hazard.rock_cover) && !request.rocks)
    in.fail("rocks", "must be true for limits on rocks");
  if (!request.footprint) return;
  // A plane needs at least three pixels, and the work grows with the square of the diameter.
  const double diameter_px = request.footprint->diameter_m / query.area.gsd_m;
  if (diameter_px < 3 || diameter_px > 256)
    in.at("footprint").fail("diameter_m", fmt::format("is {:g} pixels of gsd_m: must be 3 to 256", diameter_px));
}

const auto hazard_field =
    Property{[](const MapQuery& q) {
               return q.request.products & engine::kHazard ? std::optional(q.request.hazard) : std::nullopt;
             },
             [](MapQuery& q, const engine::HazardLimits& limits) { q.request.hazard = limits; }};

// Checks rules between members and completes the query: the grid follows from the area.
void check_map(const JsonReader& in, MapQuery& query, const ReadContext& context) {
  query.sun_utc = context.sun_utc;
  require_sun(in, map_products(), query.request.products);
  resolve_preset(query.scenery(), query.surface);
  if (!in.good()) return;  // the area may be incomplete
  check_footprint(in, query);
  const auto grid = grid_of(in.at("map"), query.area, context.limits);
  if (!grid) return;
  query.request.grid = *grid;
  // Stop before the margin is computed: with a footprint that was refused, it may span the whole Moon.
  if (!in.good()) return;
  try {
    if (engine::wants_footprint(query.request)) engine::request_with_margin(query.request);
  } catch (const ImpossibleRequest& e) {
    in.fail("footprint", e.what());
  }
}

}  // namespace

const Members<MapQuery>& map_members() {
  static const auto members = make_table<Members<MapQuery>>(
      "MapRequest",
      "A map-projected product. Unknown members are errors. `sun` is required for radiance, lit, irradiance.",
      [](auto& m) {
        // Add rows in the order of the resolved request, whose text the ETag is made from.
        m.add("map", &MapQuery::area, Object{area_members()}, "projection, extent and pixels").required();
        add_scenery(m);
        add_map_error(m);
        m.add("band", nested(&MapQuery::request, nested(&MapRequest::scenery, &FrameRequest::band)),
              Object{band_members()}, "spectral channel of the radiance; left out: all wavelengths");
        m.add(
            "view", view_field, NadirOr{},
            "viewing direction of the radiance: nadir, from straight above each pixel, or from a direction. The map's "
            "geometry does not change; ground that terrain hides from the viewer has no radiance. Left out: nadir");
        m.add("accuracy", nested(&MapQuery::request, nested(&MapRequest::scenery, &FrameRequest::accuracy)),
              Object{map_accuracy_members()}, "level of detail");
        m.add("rocks", nested(&MapQuery::request, &MapRequest::rocks), Flag{},
              "true: the rocks of `detail` are on the ground, as in frames; seen from straight above")
            .written_if([](const MapQuery& q) { return q.request.rocks; });
        m.add("footprint", nested(&MapQuery::request, &MapRequest::footprint), Object{footprint_members()},
              "footprint of `slope`, `roughness`, `rock_cover` and `hazard`");
        m.add("hazard", hazard_field, Object{hazard_members()}, "limits of the product `hazard`");
        m.add("products", nested(&MapQuery::request, &MapRequest::products), Products{map_products()},
              "arrays of height x width, row 0 in the north; NaN where there is no data or no Moon");
        m.check(check_map);
        m.add_condition([](const Limits&) { return sun_where_needed(map_products()); });
      });
  return *members;
}

MapQuery read_map(const Json& body, const Limits& limits, const Assets& assets, const StopToken& stop) {
  return map_members().read_body(body, {limits, assets, stop, utc_of_sun(body)});
}

OrderedJson resolved_json(const MapQuery& query) { return map_members().write(query); }

}  // namespace selenograph::api
