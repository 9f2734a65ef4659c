// Cameras whose rows are exposed one after the other: rolling shutters and line cameras.
#pragma once

#include <vector>

#include "engine/frame/pose.h"

namespace selenograph::engine {

struct PoseAtTime {
  double time_s = 0;  // from the exposure of row 0
  Pose pose;
};

struct Shutter {
  double line_time_s = 0;  // from the exposure of one row to that of the next; above 0
  // How the camera moves: from the frame's pose, which is that of row 0, at constant rates; or, where there are any,
  // through at least two poses at rising times, instead of the frame's pose.
  Rates rates;
  std::vector<PoseAtTime> poses;
  // A line camera: every row of the frame looks along the camera's row through the principal point. Else a rolling
  // shutter, whose rows each look along their own.
  bool pushbroom = false;
  // Of the image's top row: below 0 where the frame is rendered with a margin.
  int first_row = 0;

  // When a row of the image is exposed. Between rows, too: pixels are squares around whole numbers.
  double time_s(double row) const { return (row + first_row) * line_time_s; }
};

}  // namespace selenograph::engine
