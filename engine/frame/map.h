// A map-projected product: request and result.
#pragma once

#include <optional>

#include "dem/grid/map_grid.h"
#include "engine/frame/report.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

struct MapRequest {
  dem::MapGrid grid;
  // Sun, surface, band and accuracy. Its camera, products and objects are ignored; one pixel of `accuracy` is
  // grid.gsd_m wide.
  FrameRequest look;
  // Unit vector toward the viewer of the radiance; empty: straight above each pixel.
  std::optional<Vec3> toward_viewer;
  ProductSet products = kRadiance;
};

// A pixel holds the value at its centre. Row 0 is the northernmost. Arrays hold NaN and 65535 where there is no data or
// no Moon; radiance is also NaN where terrain hides the ground from the viewer.
struct Map {
  FrameProducts products;
  FrameReport report;  // bounds over the whole map; triangles of all its scenes
  StageTimes times;
};

}  // namespace selenograph::engine
