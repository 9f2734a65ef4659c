#include "api/answers/accuracy_report.h"

#include <fmt/format.h>

#include <functional>

#include "api/message/version.h"
#include "api/requests/frame_json.h"

namespace selenograph::api {
namespace {

using engine::SweepRow;
using OrderedJson = nlohmann::ordered_json;

// A column of the CSV: its name, which ends in its unit, and its value in a row of the sweep.
struct Column {
  const char* name;
  std::function<double(const SweepRow&)> value;
};

const std::vector<Column>& columns() {
  static const std::vector<Column> list{
      {"max_error_px", [](const SweepRow& r) { return r.setting.max_error_px; }},
      {"samples_per_pixel", [](const SweepRow& r) { return r.setting.samples_per_pixel; }},
      {"max_detail_error_px", [](const SweepRow& r) { return r.with_detail ? r.setting.max_detail_error_px : 0; }},
      {"max_shadow_error_px", [](const SweepRow& r) { return r.setting.max_shadow_error_px; }},
      {"reference_max_error_px", [](const SweepRow& r) { return r.reference_max_error_px; }},
      {"frame_ms", [](const SweepRow& r) { return r.frame_ms; }},
      {"bare_kernel_ms", [](const SweepRow& r) { return r.bare_ms; }},
      {"time_ratio", [](const SweepRow& r) { return r.ratio(); }},
      {"triangles", [](const SweepRow& r) { return static_cast<double>(r.triangles); }},
      {"scene_bytes", [](const SweepRow& r) { return static_cast<double>(r.scene_bytes); }},
      {"lod_error_px", [](const SweepRow& r) { return r.bound_px; }},
      {"lod_error_m", [](const SweepRow& r) { return r.bound_m; }},
      {"lod_error_p99_px", [](const SweepRow& r) { return r.expected_px; }},
      {"shadow_error_px", [](const SweepRow& r) { return r.shadow_bound_px; }},
      {"geometric_median_px", [](const SweepRow& r) { return r.errors.geometric_px.median; }},
      {"geometric_p999_px", [](const SweepRow& r) { return r.errors.geometric_px.p999; }},
      {"geometric_worst_px", [](const SweepRow& r) { return r.errors.geometric_px.worst; }},
      {"geometric_median_m", [](const SweepRow& r) { return r.errors.geometric_m.median; }},
      {"geometric_p999_m", [](const SweepRow& r) { return r.errors.geometric_m.p999; }},
      {"geometric_worst_m", [](const SweepRow& r) { return r.errors.geometric_m.worst; }},
      {"within_lod_error_px", [](const SweepRow& r) { return r.errors.within_bound_px; }},
      {"within_lod_error_m", [](const SweepRow& r) { return r.errors.within_bound_m; }},
      {"within_lod_error_p99_px", [](const SweepRow& r) { return r.errors.within_expected_px; }},
      {"wrong_hits", [](const SweepRow& r) { return r.errors.wrong_hits; }},
      {"radiance_rms", [](const SweepRow& r) { return r.errors.radiance_rms; }},
      {"radiance_p999", [](const SweepRow& r) { return r.errors.radiance_p999; }},
      {"wrong_shadow_flags", [](const SweepRow& r) { return r.errors.wrong_shadow_flags; }},
      {"shadow_edge_mean_px", [](const SweepRow& r) { return r.errors.shadow_edge_mean_px; }},
      {"shadow_edge_median_px", [](const SweepRow& r) { return r.errors.shadow_edge_px.median; }},
      {"shadow_edge_p999_px", [](const SweepRow& r) { return r.errors.shadow_edge_px.p999; }},
      {"shadow_edge_worst_px", [](const SweepRow& r) { return r.errors.shadow_edge_px.worst; }},
  };
  return list;
}

}  // namespace

std::string accuracy_csv(const std::vector<SweepRow>& rows) {
  std::string csv = "scene,visibility";
  for (const Column& c : columns()) csv += fmt::format(",{}", c.name);
  csv += '\n';
  for (const SweepRow& r : rows) {
    csv += r.scene + "," + std::string(visibility_name(r.visibility));
    for (const Column& c : columns()) csv += fmt::format(",{:.9g}", c.value(r));
    csv += '\n';
  }
  return csv;
}

OrderedJson accuracy_json(const std::vector<engine::AccuracyScene>& scenes, const std::string& machine) {
  const engine::Accuracy standard;
  OrderedJson json{{"machine", machine},
                   {"default",
                    {{"max_error_px", standard.max_error_px},
                     {"max_detail_error_px", standard.max_detail_error_px},
                     {"max_shadow_error_px", standard.max_shadow_error_px},
                     {"samples_per_pixel", standard.samples_per_pixel}}},
                   {"scenes", OrderedJson::array()}};
  for (const engine::AccuracyScene& scene : scenes)
    json["scenes"].push_back({{"name", scene.name}, {"description", scene.what}});
  json["software"] = fmt::format("selenograph {}", software_version());
  return json;
}

}  // namespace selenograph::api
