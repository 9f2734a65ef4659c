// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/parts/camera_preset.h"

#include <fmt/format.h>

#include <algorithm>

#include "api/requests/parts/band_json.h"
#include "api/requests/parts/camera_json.h"
#include "api/requests/parts/sensor_json.h"
#include "api/schema/member_kinds.h"

namespace selenograph::api {
namespace {

// Contents of a preset's file.
struct Preset {
  std::optional<std::string> description;
  std::optional<engine::Camera> camera;
  std::optional<engine::Band> band;
  std::optional<engine::SensorModel> sensor;
};

const Members<Preset>& preset_members() {
  static const auto table =
      make_table<Members<Preset>>("CameraPreset", "cameras/NAME.json of the assets folder.", [](auto& m) {
        m.add("description", &Preset::description, Text{}, "description of the camera; ignored");
        m.add("camera", &Preset::camera, Object{camera_members()}, "camera of requests without one");
        m.add("band", &Preset::band, Object{band_members()}, "band of requests without one");
        m.add(
            "sensor", &Preset::sensor, Object{sensor_members()},
            "sensor; members of the request's own sensor replace those here. If it is left out, a request's sensor of "
            "`seed` and `frame` alone is none");
      });
  return *table;
}

// Returns true for a "sensor" that says nothing of a sensor: a client numbers the frames of any preset.
bool only_numbers_noise(const Json& sensor) {
  if (!sensor.is_object() || sensor.empty()) return false;
  return std::ranges::all_of(sensor.items(),
                             [](const auto& member) { return member.key() == "frame" || member.key() == "seed"; });
}

}  // namespace

std::optional<Json> with_camera_preset(const Json& body, const ReadContext& context) {
  if (!body.is_object() || !body.contains("camera_preset") || !body.at("camera_preset").is_string())
    return std::nullopt;
  Findings findings;
  const JsonReader in(body, findings);
  const auto named = Asset{&Assets::camera, "preset", "cameras"}.read(in.at("camera_preset"), context);
  findings.throw_if_any();
  const Json& preset = *named->content;
  preset_members().check_file(preset, fmt::format("cameras/{}.json", named->name), context);
  Json merged = body;
  merged.erase("camera_preset");
  for (const char* member : {"camera", "band"})
    if (preset.contains(member) && !merged.contains(member)) merged[member] = preset.at(member);
  if (preset.contains("sensor")) {
    Json sensor = preset.at("sensor");
    if (merged.contains("sensor")) sensor.merge_patch(merged["sensor"]);
    merged["sensor"] = sensor;
  } else if (merged.contains("sensor") && only_numbers_noise(merged["sensor"])) {
    merged.erase("sensor");
  }
  return merged;
}

}  // namespace selenograph::api
