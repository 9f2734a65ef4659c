#include "engine/lidar/pattern.h"

#include <cmath>

namespace selenograph::engine {
namespace {

// A shot is one pass of the pattern, repeated `repeats` times.
std::size_t beams_per_shot(const LidarPattern& p) {
  switch (p.scan) {
    case LidarScan::flash:
    case LidarScan::raster:
      return static_cast<std::size_t>(p.columns) * static_cast<std::size_t>(p.rows);
    case LidarScan::cone:
      return static_cast<std::size_t>(p.beams);
    case LidarScan::beams:
      return p.directions.size();
  }
  return 0;
}

// Returns whether all beams of a shot are fired at the same time.
bool is_simultaneous(LidarScan scan) { return scan == LidarScan::flash || scan == LidarScan::beams; }

// Returns the centre of a cell of a row of cells from -1/2 to 1/2.
double cell_centre(std::size_t cell, int cells) { return (static_cast<double>(cell) + 0.5) / cells - 0.5; }

Vec3 direction_of(const LidarPattern& p, std::size_t i) {
  const auto columns = static_cast<std::size_t>(p.columns);
  switch (p.scan) {
    case LidarScan::flash: {
      const double side = 2 * std::tan(p.fov_x_deg * kRadiansPerDegree / 2);
      const double x = side * cell_centre(i % columns, p.columns),
                   y = side * p.rows / p.columns * cell_centre(i / columns, p.rows);
      return Vec3(x, y, 1).normalized();
    }
    case LidarScan::raster: {
      const std::size_t row = i / columns, along = i % columns;
      const std::size_t column = p.serpentine && row % 2 == 1 ? columns - 1 - along : along;
      const double x = p.fov_x_deg * kRadiansPerDegree * cell_centre(column, p.columns),
                   y = p.fov_y_deg * kRadiansPerDegree * cell_centre(row, p.rows);
      // A mirror turning about y scans a line; a mirror turning about x steps to the next line.
      return {std::sin(x), std::sin(y) * std::cos(x), std::cos(y) * std::cos(x)};
    }
    case LidarScan::cone: {
      const double azimuth = 360 * kRadiansPerDegree * static_cast<double>(i) / p.beams,
                   from_axis = p.half_angle_deg * kRadiansPerDegree;
      return {std::sin(from_axis) * std::cos(azimuth), std::sin(from_axis) * std::sin(azimuth), std::cos(from_axis)};
    }
    case LidarScan::beams:
      return p.directions[i];
  }
  return Vec3::unit_z();
}

}  // namespace

std::size_t LidarBeams::beams_of(const LidarPattern& pattern) {
  return beams_per_shot(pattern) * static_cast<std::size_t>(pattern.repeats);
}

LidarPulse LidarBeams::at(std::size_t i) const {
  if (!pulses_.empty()) return pulses_[i];
  const std::size_t per_shot = beams_per_shot(pattern_), number = is_simultaneous(pattern_.scan) ? i / per_shot : i;
  return {pattern_.rate_hz > 0 ? static_cast<double>(number) / pattern_.rate_hz : 0,
          direction_of(pattern_, i % per_shot)};
}

double last_time_s(const LidarPattern& p) {
  const std::size_t shots = is_simultaneous(p.scan) ? static_cast<std::size_t>(p.repeats) : LidarBeams::beams_of(p);
  return p.rate_hz > 0 && shots > 0 ? static_cast<double>(shots - 1) / p.rate_hz : 0;
}

}  // namespace selenograph::engine
