// Moments that sample an exposure in motion.
#pragma once

#include <span>
#include <vector>

#include "engine/frame/request.h"
#include "engine/scene/selection.h"

namespace selenograph::engine {

// Longest image motion during an exposure, px, over a grid of places. The ground is taken as a sphere through the
// height `ground_m` (above the datum) below the camera; higher ground moves slightly more. Objects are counted at the
// nearest point of their bounding sphere.
double longest_streak_px(const FrameRequest& request, double integration_time_s, double ground_m,
                         std::span<const Ball> objects);

// Number of moments: as requested, or the streak's length in pixels, odd, at most Motion::kMaxMoments.
int motion_samples(const Motion& motion, double longest_streak_px);

// Times of the moments, seconds from the exposure's middle.
std::vector<double> moments_of(int samples, double integration_time_s);

}  // namespace selenograph::engine
