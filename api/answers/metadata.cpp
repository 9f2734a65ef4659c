#include "api/answers/metadata.h"

#include <fmt/format.h>

#include <algorithm>

#include "api/answers/eclipse.h"
#include "api/answers/turned_sky.h"
#include "api/answers/view_json.h"
#include "api/message/json_text.h"
#include "api/message/version.h"
#include "api/requests/parts/detail_json.h"
#include "dem/base/hash.h"
#include "engine/sensor/detector.h"
#include "engine/sky/star_catalogue.h"

namespace selenograph::api {
namespace {

std::string hex(std::uint64_t x) { return fmt::format("{:016x}", x); }

double largest_limit_px(const std::vector<double>& shadow_limits_px) {
  return *std::max_element(shadow_limits_px.begin(), shadow_limits_px.end());
}

bool shadows_were_relaxed(const engine::Accuracy& requested, const std::vector<double>& shadow_limits_px) {
  return largest_limit_px(shadow_limits_px) > requested.max_shadow_error_px;
}

// Adds the notes of the objects' meshes, and warnings about objects of an implausible size.
void add_object_warnings(const FrameQuery& query, OrderedJson& warnings) {
  for (std::size_t i = 0; i < query.objects.size(); ++i) {
    const engine::SceneObject& object = query.request.objects[i];
    const auto warn = [&](const std::string& text) {
      warnings.push_back(fmt::format("objects/{}, {}: {}", i, query.objects[i].mesh, text));
    };
    for (const std::string& note : object.mesh->notes()) warn(note);
    const double diameter_m = 2 * object.scale * object.mesh->radius();
    if (diameter_m > 1e6 || diameter_m < 1e-3)
      warn(fmt::format("is {:.3g} m across: \"scale\" makes metres of a file's units", diameter_m));
  }
}

// Adds warnings about charge that moves against the image, and about more time than its lines have.
void add_tdi_warnings(const engine::DelayedIntegration& tdi, double line_time_s, const engine::FrameReport& report,
                      OrderedJson& warnings) {
  if (report.longest_streak_px > tdi.stages)
    warnings.push_back(fmt::format(
        "the image moves off its charge by {:.0f} pixels within {} stages of sensor.tdi (motion.longest_streak_px): "
        "check tdi.reversed, the shutter's line_time_s and the camera's velocity",
        report.longest_streak_px, tdi.stages));
  if (report.integration_time_s > tdi.stages * line_time_s)
    warnings.push_back(fmt::format(
        "the integration time, {:g} s, is longer than the stages of sensor.tdi have: {} x line_time_s are {:g} s",
        report.integration_time_s, tdi.stages, tdi.stages * line_time_s));
}

// Adds warnings about an exposure out of reach of its target, gaps in motion blur, and a signal below the noise.
void add_sensor_warnings(const engine::FrameRequest& request, const engine::FrameReport& report,
                         OrderedJson& warnings) {
  const engine::SensorModel& sensor = *request.sensor;
  const double target = sensor.exposure.target_fill;  // share of a pixel's capacity; 0: no automatic exposure
  const double full_e = engine::saturation_e(sensor.detector);
  if (target > 0 && report.smear_fill * full_e >= engine::filled_e(sensor.detector, target))
    warnings.push_back(
        "exposure.target_fill is out of reach: smear alone fills more of a pixel (exposure.smear_fill); shorten "
        "detector.smear_time_s");
  else if (target > 0 && (report.integration_time_s == sensor.exposure.longest_s ||
                          report.integration_time_s == sensor.exposure.shortest_s))
    warnings.push_back(
        fmt::format("exposure.{} limits the integration time: the metered pixels do not fill exposure.target_fill",
                    report.integration_time_s == sensor.exposure.longest_s ? "longest_s" : "shortest_s"));
  // Samples more than 1.5 pixels apart leave visible gaps in a streak.
  if (report.motion_samples > 0 && report.longest_streak_px > 1.5 * report.motion_samples)
    warnings.push_back(fmt::format(
        "the longest streak of motion (motion.longest_streak_px) is averaged over too few moments "
        "(motion.samples): there are gaps in it; {}",
        sensor.motion.samples || sensor.tdi.samples ? "samples of the sensor's motion or tdi may be left out or larger"
                                                    : "samples of the sensor's motion or tdi may be larger"));
  if (!sensor.tdi.none()) add_tdi_warnings(sensor.tdi, request.shutter->line_time_s, report, warnings);
  const engine::Detector& d = sensor.detector;
  if (report.brightest_signal_e > 0 && report.brightest_signal_e < std::max(d.read_noise_e, d.gain_e_dn / 2))
    warnings.push_back(
        "the signal is below the read noise, or below half a digital number, in every pixel "
        "(exposure.brightest_signal_e): check the units of the band (um), the pixel pitch (um) and the integration "
        "time (s)");
}

// Returns all warnings of a frame. `covered_share` is the share of the Sun's disc that the Earth covers.
OrderedJson warnings_json(const FrameQuery& query, const engine::FrameReport& report, const dem::Catalogue& catalogue,
                          double covered_share) {
  OrderedJson warnings = report.warnings;
  warn_of_relaxed_targets(query.request.accuracy, report, warnings);
  warn_of_band(query.request, warnings);
  warn_of_eclipse(covered_share, kSunCovered, warnings);
  warn_of_turned_sky(query.request, query.icrf_lag_s, warnings);
  constexpr double kMaxSaturated = 0.01;
  const engine::ProductSet products = query.request.products;
  const auto& sensor = query.request.sensor;
  if (report.saturated_fraction > kMaxSaturated)
    warnings.push_back(fmt::format("more than 1 % of the image is saturated ({}saturated_fraction): {}",
                                   sensor ? "exposure." : "",
                                   !sensor                  ? "raise image.full_scale_radiance"
                                   : report.smear_fill >= 1 ? "smear alone fills pixels; shorten detector.smear_time_s"
                                                            : "expose shorter"));
  if (sensor) add_sensor_warnings(query.request, report, warnings);
  if (products & (engine::kImage | engine::kRadiance) && report.hit_fraction > 0 && !report.lit)
    warnings.push_back(report.view.sun_elevation_deg
                           ? "no signal: nothing in view is lit (view.sun: where the Sun stands)"
                           : "no signal: nothing in view is lit");
  add_object_warnings(query, warnings);
  add_lens_warning(query.request.camera, warnings);
  if (query.request.terrain && products & (engine::kImage | engine::kRadiance))
    add_reflectance_warnings(query.request, query.surface, report, warnings);
  if (query.request.terrain) add_view_warnings(query, report, catalogue, warnings);
  return warnings;
}

// Replaces a list in the metadata by its length.
void omit(OrderedJson& metadata, const char* list) {
  metadata[std::string(list) + "_omitted"] = metadata.at(list).size();
  metadata[list] = OrderedJson::array();
}

}  // namespace

std::string content_hash(const FrameQuery& query, const std::vector<double>& shadow_limits_px,
                         std::uint64_t terrain_fingerprint, const Representation& representation) {
  OrderedJson hashed{{"request", resolved_json(query)},
                     {"terrain", hex(terrain_fingerprint)},
                     {"objects", objects_metadata(query.request, query.objects)},
                     {"maps", maps_metadata(query.request, query.surface)},
                     {"atmosphere", hex(Assets::fingerprint(query.request.atmosphere.get()))},
                     {"version", software_version()},
                     {"representation", representation.media_type}};
  if (query.request.sky && query.request.sky->stars) hashed["stars"] = hex(query.request.sky->stars->fingerprint());
  if (query.request.sky && query.request.sky->earth_map.content)
    hashed["earth_map"] = hex(query.request.sky->earth_map.content->fingerprint());
  if (const auto& sights = query.request.camera.sights) hashed["lines_of_sight"] = hex(sights->fingerprint());
  if (query.request.detail) hashed["detail"] = detail_metadata(query.detail, *query.request.detail);
  // Add what follows from epochs and memory, which the resolved request does not hold.
  if (shadows_were_relaxed(query.request.accuracy, shadow_limits_px)) hashed["shadow_limits_px"] = shadow_limits_px;
  if (const double share = sun_covered(query); share > 0) hashed[kSunCovered] = share;
  if (sky_turned_deg(query.request, query.icrf_lag_s) > 0) hashed["icrf_lag_s"] = query.icrf_lag_s;
  return content_hash(json_text(hashed));
}

std::string content_hash(const std::string& text) {
  dem::StreamedHash hash;
  hash.add_text(text);
  const auto [low, high] = hash.digest_128();
  return hex(high) + hex(low);
}

bool names_etag(const std::string& if_none_match, const std::string& hash) {
  // Search for the quoted hash instead of parsing the list: a hash contains neither quote nor comma.
  return if_none_match == "*" || if_none_match.find("\"" + hash + "\"") != std::string::npos;
}

void warn_of_relaxed_targets(const engine::Accuracy& requested, const engine::FrameReport& report,
                             OrderedJson& warnings) {
  const double detail_px = requested.detail_aim_px();
  const bool has_detail = report.detail_limit_px > 0;
  if (report.expected_error_px > detail_px)
    warnings.push_back(
        fmt::format("the mesh's error exceeds the target: in 1 % of the pixels it is expected to be more than "
                    "{:.2g} px (lod_error_p99_px), where {:g} px were requested",
                    report.expected_error_px, detail_px));
  const std::string too_much =
      fmt::format("it would take more than {:g} triangles a pixel and more than {:g} million",
                  engine::Accuracy::kDetailTrianglesPerPixel, engine::Accuracy::kMinDetailTriangles / 1e6);
  if (report.detail_limit_px > detail_px)
    warnings.push_back("max_detail_error_px was relaxed (detail_limit_px): " + too_much);
  if (shadows_were_relaxed(requested, report.shadow_limits_px))
    warnings.push_back(
        has_detail ? fmt::format("max_shadow_error_px was relaxed (shadow_limit_px): {}, or more terrain than the "
                                 "service's memory for scenes holds",
                                 too_much)
                   : std::string("max_shadow_error_px was relaxed (shadow_limit_px): the terrain that it takes does "
                                 "not fit into the service's memory for scenes"));
}

void warn_of_band(const engine::FrameRequest& request, OrderedJson& warnings) {
  constexpr double kMaxPlausible_um = 100;  // thermal cameras end before
  if (request.band && request.band->center_um() > kMaxPlausible_um)
    warnings.push_back(
        fmt::format("the band is centred beyond {} um: is it in nanometres? 550 nm are 0.55 um", kMaxPlausible_um));
}

OrderedJson metadata(const FrameQuery& query, const engine::FrameReport& report, const dem::Catalogue& catalogue,
                     const std::string& hash, const FrameLabels* labels) {
  const double covered_share = sun_covered(query);
  return metadata_answer().write({.request = query.request,
                                  .products = query.request.products,
                                  .scenery = query,
                                  .report = report,
                                  .hash = hash,
                                  .resolved = resolved_json(query),
                                  .warnings = warnings_json(query, report, catalogue, covered_share),
                                  .sun_covered = covered_share,
                                  .labels = labels,
                                  .frame = &query,
                                  .map = nullptr});
}

std::string metadata_text(const OrderedJson& metadata, bool with_craters) {
  return json_text(metadata, with_craters ? -1 : 2);
}

void add_warnings(Response& response, const OrderedJson& warnings) {
  if (warnings.empty()) return;
  OrderedJson list = OrderedJson::array();
  for (const OrderedJson& text : warnings) {
    list.push_back(text);
    if (json_ascii(list).size() <= kMetaHeaderBytes) continue;
    list.erase(list.size() - 1);
    break;
  }
  response.headers.emplace_back("Selenograph-Warnings", json_ascii(list));
}

MetadataHeader metadata_header(OrderedJson metadata) {
  if (std::string text = json_ascii(metadata); text.size() <= kMetaHeaderBytes) return {std::move(text), true};
  const std::string hash = metadata.at("content_hash"), path = "/v1/frames/" + hash + "/meta";
  metadata["metadata_at"] = path;
  for (const char* list : {"craters", "sources", "warnings"}) {
    if (!metadata.contains(list)) continue;
    omit(metadata, list);
    if (std::string text = json_ascii(metadata); text.size() <= kMetaHeaderBytes) return {std::move(text), false};
  }
  return {json_ascii(OrderedJson{{"content_hash", hash}, {"metadata_at", path}}), false};
}

}  // namespace selenograph::api
