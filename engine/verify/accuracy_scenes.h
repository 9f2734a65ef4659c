// The views on which speed is measured against error: what a lander sees on its way down.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dem/terrain/terrain.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

struct AccuracyScene {
  std::string name, what;
  std::vector<FrameRequest> frames;  // accuracy and products are the sweep's to choose
};

// Square frames of side_px pixels, 50 degrees wide, but for the descent seen from height_m. Heights are above the
// ground at the place. The low Sun of the polar scene needs no pole, but terrain where such a Sun is the usual one;
// without a place for it there is no such scene.
std::vector<AccuracyScene> accuracy_scenes(const dem::Terrain& terrain, const Geographic& place,
                                           const std::optional<Geographic>& polar_place, int side_px,
                                           double height_m = 20e3);

// The end of the descent, where there is a detail. `detailed`: the terrain with it (Renderer::terrain_with).
AccuracyScene touchdown_scene(const dem::Terrain& detailed, const std::shared_ptr<const dem::Detail>& detail,
                              const Geographic& place, int side_px);

// The camera above a place whose boresight is tilted from the nadir towards north, east to the right.
Pose tilted_pose(const Vec3& position_m, double tilt_deg);

}  // namespace selenograph::engine
