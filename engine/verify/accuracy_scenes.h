// Views for measuring speed against error: a lander's views during its descent.
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
  std::optional<Accuracy> own{};     // measured besides the sweep's settings
};

// Returns the scenes: square frames of side_px pixels, 50 degrees wide, seen from height_m above the ground, except for
// the descent, which has heights of its own. `polar_place`: a place where the Sun is always low, for the polar scene;
// empty: no such scene.
std::vector<AccuracyScene> accuracy_scenes(const dem::Terrain& terrain, const Geographic& site,
                                           const std::optional<Geographic>& polar_place, int side_px, double height_m);

// Returns the end of the descent, on terrain with detail. `detailed`: Renderer::terrain_with(detail).
AccuracyScene touchdown_scene(const dem::Terrain& detailed, const std::shared_ptr<const dem::Detail>& detail,
                              const Geographic& site, int side_px);

// Returns the pose of a camera with the boresight tilted from the nadir towards north, and east to the right.
Pose tilted_pose(const Vec3& position_m, double tilt_deg);

}  // namespace selenograph::engine
