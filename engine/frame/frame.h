// What the engine answers: products, report, times.
#pragma once

#include "engine/frame/products.h"
#include "engine/frame/report.h"

namespace selenograph::engine {

struct Frame {
  FrameProducts products;
  FrameReport report;
  StageTimes times;
};

}  // namespace selenograph::engine
