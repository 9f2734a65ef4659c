// Tables of an answer's members (api/schema/answers.h). A row is a.add(name in JSON, JSON Schema, function that returns
// the value, condition); a member without a condition is always written.
#include "api/answers/metadata_members.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "api/answers/crater_answer.h"
#include "api/answers/view_json.h"
#include "api/json/ranges.h"
#include "api/message/version.h"
#include "api/requests/parts/detail_json.h"
#include "dem/gdal/geotiff_writer.h"
#include "engine/frame/needs.h"
#include "engine/radiometry/brdf.h"
#include "engine/radiometry/photometry.h"

namespace selenograph::api {
namespace {

using engine::FrameReport;

// Conditions under which members are written. A member of frames alone has one that needs `frame`; maps share the
// others.
bool of_frame(const MetadataSource& s) { return s.frame != nullptr; }
bool with_terrain(const MetadataSource& s) { return s.frame && s.request.terrain; }
bool with_detail(const MetadataSource& s) { return s.request.detail != nullptr; }
bool with_objects(const MetadataSource& s) { return s.frame && !s.frame->objects.empty(); }
bool with_light(const MetadataSource& s) { return (s.products & (engine::kImage | engine::kRadiance)) != 0; }
bool with_image(const MetadataSource& s) { return (s.products & engine::kImage) != 0; }
bool by_sensor(const MetadataSource& s) { return with_image(s) && s.request.sensor; }

auto reported(double FrameReport::*field) {
  return [field](const MetadataSource& s) { return s.report.*field; };
}

OrderedJson sources_json(const MetadataSource& s) {
  OrderedJson sources = OrderedJson::array();
  for (const engine::SourceTile& tile : s.report.sources)
    sources.push_back({{"name", tile.name}, {"version", fmt::format("{:016x}", tile.version)}});
  return sources;
}

// Returns the solar irradiance at the Moon, E_sun tau of SENSOR++ eq. (2), with its band and source.
OrderedJson irradiance_json(const MetadataSource& s) {
  const engine::FrameRequest& request = s.request;
  const double value_w_m2 = s.report.radiance.direct_w_m2;
  if (!request.band)
    return {{"value_w_m2", value_w_m2},
            {"band", "all wavelengths"},
            {"source", fmt::format("{} W m-2 at 1 au (IAU 2015 resolution B3, after Kopp & Lean 2011), times 1/r^2",
                                   engine::kSolarConstant_w_m2)}};
  return {
      {"value_w_m2", value_w_m2},
      {"band", fmt::format("centre {:.6g} um, width {:.6g} um", request.band->center_um(), request.band->width_um())},
      {"source", request.atmosphere
                     ? "the atmosphere's table: E_sun tau, times 1/r^2"
                     : fmt::format("ASTM E-490-00a (2000), 1 nm to 2 nm resolution below 2.5 um, scaled to {} W m-2 at "
                                   "1 au, times 1/r^2",
                                   engine::kSolarConstant_w_m2)}};
}

void add_request(Answer<MetadataSource>& a) {
  using namespace schema;
  a.add("software", free_object("name and version"), [](const MetadataSource&) {
    return OrderedJson{{"name", "selenograph"}, {"version", software_version()}};
  });
  a.add("content_hash", text("the ETag without quotes"), [](const MetadataSource& s) { return s.hash; });
  a.add("request",
        with_keyword(
            ref("FrameRequest"), "description",
            "The request as understood: pose in MOON_ME and opencv axes, intrinsics, Sun vector. A valid request "
            "itself"),
        [](const MetadataSource& s) { return s.resolved; });
  a.add(
      "grid", free_object("of a map: width, height, pixel, geotransform, wkt"),
      [](const MetadataSource& s) { return grid_json(s.map->request.grid); },
      [](const MetadataSource& s) { return s.map != nullptr; });
}

void add_radiometry(Answer<MetadataSource>& a) {
  using namespace schema;
  a.add(
      "reflectance",
      free_object("normalisation: the equation as printed in the paper; of a preset of the Moon uncertainty of the "
                  "disc's irradiance (relative, k = 2), extrapolated_sunlight (share of the band's, beyond 0.35 to 2.5 "
                  "um) and, of a frame, phase_deg (smallest and largest over the image)"),
      [](const MetadataSource& s) { return reflectance_metadata(s.request, s.report); },
      [](const MetadataSource& s) { return s.frame ? s.scenery.sun_given : with_light(s); });
  a.add(
      kSunCovered,
      number(kUnitInterval,
             "share of the Sun's disc that the Earth covers at the epoch that gives the Sun, seen from the ground "
             "below the camera or in the map's middle, if not 0: the light is not reduced"),
      [](const MetadataSource& s) { return s.sun_covered; }, [](const MetadataSource& s) { return s.sun_covered > 0; });
  a.add("solar_irradiance", free_object("value_w_m2 at the Moon after 1/r^2, its band and source"), irradiance_json,
        with_light);
  a.add(
      "radiance_terms",
      list(text("direct, indirect, scattered, emitted, thermal_path, from_terrain, from_earth"), 7,
           "evaluated components of radiance: SENSOR++ eq. (1)"),
      [](const MetadataSource& s) {
        auto names = s.report.radiance.names();
        if (s.frame && s.report.emits_elsewhere && !s.report.radiance.emitted) names.emplace_back("emitted");
        if (engine::wants_indirect(s.request) && s.request.indirect.terrain) names.emplace_back("from_terrain");
        if (engine::wants_indirect(s.request) && s.request.indirect.earth) names.emplace_back("from_earth");
        return names;
      },
      with_light);
}

void add_further_bounces(Answer<MetadataSource>& a) {
  a.add(
      "indirect",
      schema::free_object(
          "for light from terrain: ground_view, the largest share of ground in the hemisphere of a point in view; "
          "albedo of the model for diffuse light, or 1 where `albedo_maps` are used; further_bounces_at_most, the "
          "bound that follows on light reflected more often than the request's `bounces` n: (a V)^n / (1 - a V) of the "
          "largest irradiance from terrain on any ground, in view or not; shadow_light_at_least, a bound by "
          "measurement on "
          "the mean light from terrain on ground in shadow over the exact light: 0.88 where the Sun is 5 degrees or "
          "higher in the middle of the image, 0.8 from 2 degrees, null below, without ground there and in maps"),
      [](const MetadataSource& s) {
        const double albedo =
            s.request.albedo_maps.empty()
                ? engine::diffuse_albedo(engine::Brdf(s.request.reflectance, engine::band_of(s.request)))
                : 1;
        // Each bounce returns at most this share of the light, a V in the description. Below 1 the geometric series of
        // the further bounces, with sum (a V)^n / (1 - a V), converges.
        const double reflected = std::min(albedo * s.report.ground_view, 0.99);
        const std::optional<double> sun_deg = s.report.view.sun_elevation_deg;
        return OrderedJson{
            {"ground_view", s.report.ground_view},
            {"albedo", albedo},
            {"further_bounces_at_most", std::pow(reflected, s.request.indirect.bounces) / (1 - reflected)},
            {"shadow_light_at_least",
             sun_deg ? answer_json(engine::IndirectLight::shadow_light_at_least(*sun_deg)) : OrderedJson()}};
      },
      [](const MetadataSource& s) { return engine::wants_indirect(s.request) && s.request.indirect.terrain; });
}

void add_exposure(Answer<MetadataSource>& a) {
  using namespace schema;
  a.add("full_scale_radiance_w_m2_sr", number(kAnyNumber, "radiance of the largest digital number of `image`"),
        reported(&FrameReport::full_scale_radiance_w_m2_sr), with_image);
  a.add("saturated_fraction", number(kUnitInterval, "share of the pixels of an `image` without a sensor"),
        reported(&FrameReport::saturated_fraction),
        [](const MetadataSource& s) { return with_image(s) && !s.request.sensor; });
  a.add(
      "exposure",
      free_object("for a sensor: integration_time_s; saturated_fraction of the pixels; smear_fill, the share of a "
                  "pixel's capacity that smear alone fills; brightest_signal_e, electrons that light frees in the "
                  "brightest pixel, after the optics, without smear, dark current and noise"),
      [](const MetadataSource& s) {
        return OrderedJson{{"integration_time_s", s.report.integration_time_s},
                           {"saturated_fraction", s.report.saturated_fraction},
                           {"smear_fill", s.report.smear_fill},
                           {"brightest_signal_e", s.report.brightest_signal_e}};
      },
      by_sensor);
  a.add(
      "motion",
      free_object("for an exposure in motion: samples, the number of moments averaged; longest_streak_px, the "
                  "approximate motion of ground or objects in the image meanwhile"),
      [](const MetadataSource& s) {
        return OrderedJson{{"samples", s.report.motion_samples}, {"longest_streak_px", s.report.longest_streak_px}};
      },
      [](const MetadataSource& s) { return with_image(s) && s.report.motion_samples > 0; });
  a.add(
      "point_spread",
      free_object("for an image by a sensor: margin_px rendered around it (included in the shares of pixels below), "
                  "captured_fraction of a point's light within the kernel (\"airy\": 12 rings, 32 pixels at most; the "
                  "rest is spread over the kernel)"),
      [](const MetadataSource& s) {
        return OrderedJson{{"margin_px", s.report.margin_px}, {"captured_fraction", s.report.captured_fraction}};
      },
      by_sensor);
  a.add(
      "stray_light",
      free_object("for an image by a sensor with stray light: scattered_fraction of all light; glare_w_m2_sr, the "
                  "largest from a Sun outside the image"),
      [](const MetadataSource& s) {
        return OrderedJson{{"scattered_fraction", s.report.scattered_fraction},
                           {"glare_w_m2_sr", s.report.glare_w_m2_sr}};
      },
      [](const MetadataSource& s) { return by_sensor(s) && s.report.scattered_fraction > 0; });
}

void add_geometry(Answer<MetadataSource>& a) {
  using namespace schema;
  // The schema lists the two algorithms only: a report never names "auto".
  a.add(
      "visibility", with_keyword(words(kVisibilities, "that the frame was made with"), "enum", {"zbuffer", "raytrace"}),
      [](const MetadataSource& s) { return visibility_name(s.report.visibility); }, of_frame);
  a.add("lod_error_px", number(kAnyNumber, "level-of-detail error bound actually reached, pixels"),
        reported(&FrameReport::lod_error_px));
  a.add("lod_error_m", number(kAnyNumber, "level-of-detail error bound actually reached, metres"),
        reported(&FrameReport::lod_error_m));
  a.add("lod_error_p99_px",
        number(kAnyNumber,
               "expected error: 99 % of the pixels are displaced by less. lod_error_px is larger: it assumes the "
               "deepest crater of each size at the worst point of the worst block"),
        reported(&FrameReport::expected_error_px));
  a.add("lod_error_p99_m", number(kAnyNumber, "99th percentile of the expected vertical error, in metres"),
        reported(&FrameReport::expected_error_m));
  a.add("shadow_error_px",
        number(kAnyNumber,
               "bound on the displacement of shadow edges on level ground by the mesh's error, pixels. It holds for "
               "the edge itself: between the pixels of two frames it may be larger by up to a pixel's diagonal"),
        reported(&FrameReport::shadow_error_px));
  a.add("shadow_limit_px",
        number(kAnyNumber,
               "max_shadow_error_px as used; a warning says where it was relaxed. With detail, it limits what 99 % of "
               "the omitted ground is expected to do, and shadow_error_px is larger: it assumes the deepest crater"),
        [](const MetadataSource& s) { return std::ranges::max(s.report.shadow_limits_px); });
  a.add("detail_error_px", number(kAnyNumber, "contribution of the omitted detail to lod_error_px"),
        reported(&FrameReport::detail_error_px), with_detail);
  a.add("detail_limit_px", number(kAnyNumber, "max_detail_error_px as used; a warning says where it was relaxed"),
        reported(&FrameReport::detail_limit_px), with_detail);
  a.add("post_spacing_m", free_object("min and max over the mesh in view"), [](const MetadataSource& s) {
    return OrderedJson{{"min", s.report.min_post_spacing_m}, {"max", s.report.max_post_spacing_m}};
  });
  a.add("triangles", {{"type", "integer"}, {"description", "number of triangles of the scene"}},
        [](const MetadataSource& s) { return s.report.triangles; });
  a.add("hit_fraction", number(kUnitInterval, "share of pixels that see the Moon or an object"),
        reported(&FrameReport::hit_fraction));
}

void add_craters(Answer<MetadataSource>& a) {
  using namespace schema;
  const auto with_craters = [](const MetadataSource& s) { return s.frame && s.request.craters; };
  a.add(
      "craters",
      array(crater_answer().schema(), "craters that the frame shows, the largest first, if requested or with `labels`"),
      [](const MetadataSource& s) {
        OrderedJson craters = crater_answer().write_all(s.report.craters.rims);
        for (std::size_t i = 0; s.labels && i < craters.size(); ++i) craters[i]["mask_id"] = s.labels->crater_ids[i];
        return craters;
      },
      with_craters);
  a.add(
      "craters_cut_off",
      integer(0, 1'000'000'000, "more in view that are left out: the camera cannot image all of their rim"),
      [](const MetadataSource& s) { return s.report.craters.cut_off; }, with_craters);
  a.describe("craters_omitted", {{"type", "integer"}, {"description", "in the header only: number left out"}});
}

void add_content(Answer<MetadataSource>& a) {
  using namespace schema;
  a.add(
      "detail",
      free_object("for a request with a detail: name, version, the synthetic part of the terrain, and the "
                  "sources of its laws"),
      [](const MetadataSource& s) { return detail_metadata(s.scenery.detail, *s.request.detail); }, with_detail);
  a.add(
      "map_error",
      free_object("for a map with `map_error`: its members with those of its preset, and `sources`, where the preset's "
                  "figures were published"),
      [](const MetadataSource& s) { return map_error_metadata(*s.map->map_error); },
      [](const MetadataSource& s) { return s.map && s.map->map_error; });
  a.add(
      "rocks",
      object("of a detail that has rocks",
             {{"number", number(above(0).to(1e9), "in view, or whose shadow may be")},
              {"least_px", number(kAnyNumber,
                                  "minimum diameter shown, in pixels: 2 max_error_px, at least 0.5, or more where they "
                                  "would be too many; not in lod_error_m")},
              {"fraction", number(kUnitInterval, "share of pixels that see one")}},
             {"number", "least_px", "fraction"}),
      [](const MetadataSource& s) {
        const FrameReport& r = s.report;
        return OrderedJson{{"number", r.rocks}, {"least_px", r.least_rock_px}, {"fraction", r.rock_fraction}};
      },
      [](const MetadataSource& s) { return s.frame && s.report.least_rock_px > 0; });
  add_craters(a);
  a.add(
      "labelled_rocks", array(rock_answer().schema(), "with `labels`: the rocks in `rock_mask`, the largest first"),
      [](const MetadataSource& s) { return rock_answer().write_all(s.labels->rocks); },
      [](const MetadataSource& s) { return s.labels != nullptr; });
  a.add(
      "maps", {{"type", "array"}, {"description", "of each map of the ground: name and version"}},
      [](const MetadataSource& s) { return maps_metadata(s.request, s.scenery.surface); },
      [](const MetadataSource& s) { return !maps_metadata(s.request, s.scenery.surface).empty(); });
  a.add("object_fraction", number(kUnitInterval, "share of pixels that see an object"),
        reported(&FrameReport::object_fraction), with_objects);
  a.add(
      "objects",
      {{"type", "array"}, {"description", "of each object: mesh, version (hash of its content), triangles, parts"}},
      [](const MetadataSource& s) { return objects_metadata(s.request, s.frame->objects); }, with_objects);
  a.add("filled_fraction", number(kUnitInterval, "share of pixels on posts filled by interpolation"),
        reported(&FrameReport::filled_fraction));
  a.add("blended_fraction", number(kUnitInterval, "share of pixels on posts that are bent to meet a finer layer"),
        reported(&FrameReport::blended_fraction));
  a.add("missing_fraction",
        number(kUnitInterval,
               "share of pixels that see the Moon where there is no data; the ground there is taken at height 0, or as "
               "the lowest in view if that is lower"),
        reported(&FrameReport::missing_fraction));
  a.add(
      "view", view_answer().schema(),
      [](const MetadataSource& s) {
        return view_answer().write({*s.frame, s.report.view});
      },
      with_terrain);
  const OrderedJson source =
      object("", {{"name", text("DEM tile")}, {"version", text("hash of path, size and modification time")}},
             {"name", "version"});
  a.add("sources", array(source, "what the product `source` indexes"), sources_json);
  a.describe("sources_omitted", {{"type", "integer"}, {"description", "in the header only: number left out"}});
  a.describe("warnings_omitted", {{"type", "integer"}, {"description", "in the header only: number left out"}});
  a.describe("metadata_at", text("in the header only: path of the complete metadata"));
  a.add("warnings",
        array({{"type", "string"},
               {"description", "the same text for the same problem: its numbers are in the member it names"}}),
        [](const MetadataSource& s) { return s.warnings; });
}

}  // namespace

OrderedJson grid_json(const dem::MapGrid& grid) {
  return {{"width", grid.width},
          {"height", grid.height},
          {"pixel", "a value is that at its pixel's centre"},
          {"geotransform", dem::geotransform_of(grid)},
          {"wkt", dem::wkt_of(grid.plane)}};
}

const Answer<MetadataSource>& metadata_answer() {
  static const auto answer = make_answer<MetadataSource>(
      "Information on a frame besides its pixels: meta.json in an .npz, the attribute `selenograph` of images, the "
      "header Selenograph-Meta elsewhere. The same request gives the same text. A map's metadata have the same "
      "members.",
      [](Answer<MetadataSource>& a) {
        add_request(a);
        add_radiometry(a);
        add_further_bounces(a);
        add_exposure(a);
        add_geometry(a);
        add_content(a);
      });
  return answer;
}

}  // namespace selenograph::api
