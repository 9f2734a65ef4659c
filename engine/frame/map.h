// A map-projected product: request and result.
#pragma once

#include <cstdint>
#include <optional>

#include "dem/grid/map_grid.h"
#include "engine/frame/report.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

// The ground that a lander covers around each pixel.
struct LanderFootprint {
  enum class Shape { disc, square, legs };
  Shape shape = Shape::disc;
  double diameter_m =
      10;        // diameter of the disc or of the circle through the legs' ends; the square's side, along the meridian
  int legs = 4;  // number of legs at equal angles; the plane of the slope stands on their ends
  double azimuth_deg = 0;  // azimuth of the first leg, clockwise from north
};

// Limits beyond which ground is a hazard, within the footprint; empty: not checked.
struct HazardLimits {
  std::optional<double> slope_deg, roughness_m, rock_height_m, rock_cover;
};

// Bits of the product `hazard`: which limits are exceeded.
enum Hazard : std::uint16_t { kTooSteep = 1, kTooRough = 2, kRockTooHigh = 4, kTooManyRocks = 8 };
inline constexpr std::uint16_t kNoHazardNumber = 65535;  // value without data

struct MapRequest {
  dem::MapGrid grid;
  // Sun, surface, band and accuracy. Its camera, products and objects are ignored; one pixel of its `accuracy` is
  // grid.gsd_m wide.
  FrameRequest scenery;
  // Unit vector toward the viewer of the radiance; empty: straight above each pixel.
  std::optional<Vec3> toward_viewer;
  bool rocks = false;                        // rocks of the detail stand on the map's ground
  std::optional<LanderFootprint> footprint;  // area of the hazard products; if given, of slope, too
  HazardLimits hazard;
  ProductSet products = kRadiance;
};

// A map. A pixel holds the value at its centre; row 0 is the northernmost. Arrays hold NaN and 65535 where there is no
// data or no Moon. Radiance is also NaN where terrain hides the ground from the viewer.
struct Map {
  FrameProducts products;
  FrameReport report;  // bounds over the whole map; triangles of all its scenes
  StageTimes times;
};

}  // namespace selenograph::engine
