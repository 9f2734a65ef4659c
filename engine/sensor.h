// Radiance to digital numbers. For now exposure and quantisation only.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/frame.h"

namespace selenograph::engine {

// DN = clamp(round(L / full scale * (2^bits - 1))). Answers the full scale that was used: as given, else the largest
// radiance in the frame (0 when everything is dark).
double expose(const ImageSettings& settings, const std::vector<float>& radiance, std::vector<std::uint16_t>& image);

}  // namespace selenograph::engine
