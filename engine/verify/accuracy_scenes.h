// Views for measuring speed against error: what a lander sees during its descent.
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
  std::vector<FrameRequest> frames;  // accuracy and products are set by the sweep
};

// Square frames of side_px pixels, 50 degrees wide, except the descent, which is seen from height_m. Heights are above
// the ground at the place. The polar scene needs a place where the Sun is always low; without one there is no such
// scene.
std::vector<AccuracyScene> accuracy_scenes(const dem::Terrain& terrain, const Geographic& place,
                                           const std::optional<Geographic>& polar_place, int side_px, double height_m);

// From where a pixel of those frames, seen straight down, is as large as the terrain's posts at a place.
double height_over_posts_m(const dem::Terrain& terrain, const Geographic& place, int side_px);

// The end of the descent, on terrain with detail. `detailed`: Renderer::terrain_with(detail).
AccuracyScene touchdown_scene(const dem::Terrain& detailed, const std::shared_ptr<const dem::Detail>& detail,
                              const Geographic& place, int side_px);

// Pose of a camera above a place, with the boresight tilted from the nadir towards north and east to the right.
Pose tilted_pose(const Vec3& position_m, double tilt_deg);

}  // namespace selenograph::engine
