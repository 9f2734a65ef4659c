// The craters of a detail that contain the points hit by a lidar's beams.
#pragma once

#include <cstdint>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/detail/features.h"
#include "engine/frame/lidar.h"

namespace selenograph::engine {

// For each place (MOON_ME, m; NaN: none) the id of the smallest crater in whose rim it lies, 0: none. Throws
// ImpossibleRequest (member "craters") where the law has too many craters around the places, Cancelled.
std::vector<std::uint64_t> craters_of(const std::vector<Vec3>& places, const LidarCraters& options,
                                      const dem::CraterSurvey& survey, const StopToken& stop);

}  // namespace selenograph::engine
