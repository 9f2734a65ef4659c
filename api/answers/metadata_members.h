// The members of the metadata of frames and maps.
#pragma once

#include <string>

#include "api/requests/map_json.h"
#include "api/schema/answers.h"
#include "engine/frame/report.h"

namespace selenograph::api {

std::string_view software_version();

// The member that says what an eclipse covers.
inline constexpr const char* kSunCovered = "sun_covered_fraction";

struct MetadataSource {
  const engine::FrameRequest& request;  // for a map: its look
  engine::ProductSet products;
  const SceneryQuery& scenery;
  const engine::FrameReport& report;
  const std::string& hash;
  OrderedJson resolved, warnings;
  double sun_covered;
  // One of these is set.
  const FrameQuery* frame = nullptr;
  const MapQuery* map = nullptr;
};
const Answer<MetadataSource>& metadata_answer();

}  // namespace selenograph::api
