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
  // Motion of the camera: from the frame's pose, which is that of row 0, at constant rates; or through at least two
  // poses at increasing times, which replace the frame's pose.
  Rates rates;
  std::vector<PoseAtTime> poses;
  // True: a line camera; every row of the frame is imaged by the camera's row through the principal point. False: a
  // rolling shutter; each row of the frame is imaged by its own row of the camera.
  bool pushbroom = false;
  // Row number of the image's top row: negative if the frame is rendered with a margin.
  int first_row = 0;
  // A line camera may collect a row's charge in several places: this one is so many lines below the principal point,
  // and the charge is there so long after the row's own time.
  double line_px = 0, delay_s = 0;

  // Returns the exposure time of a row. Fractional rows are valid: a pixel is a square around an integer position.
  double time_s(double row) const { return (row + first_row) * line_time_s + delay_s; }
};

}  // namespace selenograph::engine
