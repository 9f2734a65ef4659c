// Table of the members of the metadata of frames and maps.
#pragma once

#include <string>

#include "api/answers/labels.h"
#include "api/requests/map_json.h"
#include "api/schema/answers.h"
#include "engine/frame/report.h"

namespace selenograph::api {

// Returns a map's size, geotransform and coordinate system.
OrderedJson grid_json(const dem::MapGrid& grid);

// Name of the member with the eclipsed share of the Sun's disc.
inline constexpr const char* kSunCovered = "sun_covered_fraction";

// Input of the metadata.
struct MetadataSource {
  const engine::FrameRequest& request;  // for a map: its scenery
  engine::ProductSet products;
  const SceneryQuery& scenery;  // the part of the query that names assets and the Sun's epoch
  const engine::FrameReport& report;
  const std::string& hash;              // content hash
  OrderedJson resolved;                 // the resolved request
  OrderedJson warnings;                 // array of texts
  double sun_covered;                   // share of the Sun's disc, 0 to 1
  const FrameLabels* labels = nullptr;  // null: a request without labels
  // Exactly one of these is set.
  const FrameQuery* frame = nullptr;
  const MapQuery* map = nullptr;
};
const Answer<MetadataSource>& metadata_answer();

}  // namespace selenograph::api
