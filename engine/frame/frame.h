// Result of a frame: products, report, times.
#pragma once

#include <vector>

#include "dem/detail/rocks_on_ground.h"
#include "engine/frame/products.h"
#include "engine/frame/report.h"

namespace selenograph::engine {

struct Frame {
  FrameProducts products;
  FrameReport report;
  std::vector<dem::RockFeature> rocks;  // with kRock: all rocks in the scene, the largest first
  StageTimes times;
};

}  // namespace selenograph::engine
