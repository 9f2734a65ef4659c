// The moments that stand for an exposure in motion.
#pragma once

#include <span>
#include <vector>

#include "engine/frame/request.h"
#include "engine/scene/selection.h"

namespace selenograph::engine {

// How far what is in view moves in the image during an exposure of so many seconds, px: the longest of a grid of
// places, along its way. The ground counts as a sphere through its height `ground_m` below the camera, above the sphere
// of 1 737 400 m: what rises from it moves a little farther. Objects count from the ball's nearest point.
double longest_streak_px(const FrameRequest& request, double integration_time_s, double ground_m,
                         std::span<const Ball> objects);

// As many as the request says, or as the streak has pixels: odd, Motion::kMostMoments at most.
int motion_samples(const Motion& motion, double longest_streak_px);

// Seconds from the exposure's middle.
std::vector<double> moments_of(int samples, double integration_time_s);

}  // namespace selenograph::engine
