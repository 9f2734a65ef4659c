// "sensor": optics and detector, and the one table of the detector's numbers.
#pragma once

#include <span>
#include <string_view>

#include "api/assets.h"
#include "api/json_reader.h"
#include "engine/frame/sensor_model.h"

namespace selenograph::api {

struct DetectorMember {
  std::string_view name;
  Range range;
  bool required;
  const char* description;
  double engine::Detector::*of;
};
std::span<const DetectorMember> detector_members();

inline constexpr std::pair<std::string_view, engine::PointSpread::Model> kPointSpreads[] = {
    {"none", engine::PointSpread::Model::none},
    {"gaussian", engine::PointSpread::Model::gaussian},
    {"airy", engine::PointSpread::Model::airy},
    {"kernel", engine::PointSpread::Model::kernel},
};
inline constexpr std::pair<std::string_view, engine::Vignetting::Model> kVignettings[] = {
    {"none", engine::Vignetting::Model::none},
    {"cos4", engine::Vignetting::Model::cos4},
    {"table", engine::Vignetting::Model::table},
};
inline constexpr std::int64_t kMaxSeed = std::int64_t{1} << 53;  // what JSON's numbers hold exactly everywhere
inline constexpr int kMaxMotionSamples = 256;
inline constexpr std::size_t kMaxKernelSide = 65;
inline constexpr std::size_t kMaxVignettingPoints = 1000;

engine::SensorModel read_sensor(const JsonReader& in, const Assets& assets);
nlohmann::ordered_json sensor_json(const engine::SensorModel& sensor);

}  // namespace selenograph::api
