// A map-projected product: what is asked and answered.
#pragma once

#include <optional>

#include "dem/grid/map_grid.h"
#include "engine/frame/report.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

struct MapRequest {
  dem::MapGrid grid;
  // Sun, surface, band, accuracy. What it has of a camera, of products and of objects isn't looked at; a pixel of
  // `accuracy` is grid.gsd_m wide.
  FrameRequest look;
  // Unit, toward whoever sees the radiance; empty: from straight above each pixel.
  std::optional<Vec3> toward_viewer;
  ProductSet products = kRadiance;
};

// A pixel is the value at its centre. Row 0 is in the north. Where there is no data, or no Moon, arrays hold NaN and
// 65535; radiance is NaN, too, where terrain stands before the viewer.
struct Map {
  FrameProducts products;
  FrameReport report;  // bounds over all of the map; triangles: of all scenes that it was made with
  StageTimes times;
};

}  // namespace selenograph::engine
