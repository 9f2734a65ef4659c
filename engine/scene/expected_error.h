// Expected error of a frame's terrain: the 99th percentile over its pixels. The reported upper bounds are larger: they
// hold at the worst point of the worst block, and assume there the deepest crater of each size.
#pragma once

#include <vector>

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

// Error of one block in view.
struct BlockError {
  double pixels;    // covered image area, approximately
  double error_m;   // vertical error
  double error_px;  // displacement in the image
};

// Returns the largest sine of the emission angle within a ball. It turns a vertical error into a displacement across
// the line of sight. Positions in MOON_ME.
double largest_sine_of_emission(const Vec3& camera_m, const Vec3& centre_m, double radius_m);

// Returns the smallest value that 99 % of the covered area does not exceed; 0 without blocks.
double expected_error(std::vector<BlockError> blocks, double BlockError::*member);

}  // namespace selenograph::engine
