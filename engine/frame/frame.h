// What the engine answers: products, report, times.
#pragma once

#include <vector>

#include "dem/detail/rocks_on_ground.h"
#include "engine/frame/products.h"
#include "engine/frame/report.h"

namespace selenograph::engine {

struct Frame {
  FrameProducts products;
  FrameReport report;
  std::vector<dem::RockFeature> rocks;  // with kRock: those that the frame is made with, the largest first
  StageTimes times;
};

}  // namespace selenograph::engine
