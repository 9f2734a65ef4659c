// A map-projected product: what is asked and answered.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "dem/grid/map_grid.h"
#include "engine/frame/report.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

// Bits of a set.
enum MapProduct : std::uint32_t {
  kMapRadiance = 1u << 0,
  kMapLit = 1u << 1,
  kMapHeight = 1u << 2,
  kMapSlope = 1u << 3,
  kMapNormal = 1u << 4,
  kMapSource = 1u << 5,
};
using MapProductSet = std::uint32_t;

struct MapRequest {
  dem::MapGrid grid;
  // Sun, surface, band, accuracy. What it has of a camera, of products and of objects isn't looked at; a pixel of
  // `accuracy` is grid.gsd_m wide.
  FrameRequest look;
  // Unit, toward whoever sees the radiance; empty: from straight above each pixel.
  std::optional<Vec3> toward_viewer;
  MapProductSet products = kMapRadiance;
};

// A pixel is the value at its centre. Arrays of height x width (x 3 of normals), row 0 in the north; empty unless asked
// for. Where there is no data, or no Moon, NaN and 65535.
struct MapProducts {
  std::vector<float> radiance;  // W m-2 sr-1; NaN, too, where terrain stands before the viewer
  std::vector<float> lit;
  std::vector<double> height;  // m above the sphere
  std::vector<float> slope;    // degrees, of the normal against the sphere's vertical
  std::vector<float> normal;   // MOON_ME
  std::vector<std::uint16_t> source;
};

struct Map {
  MapProducts products;
  FrameReport report;  // bounds over all of the map; triangles: of all scenes that it was made with
  StageTimes times;
};

}  // namespace selenograph::engine
