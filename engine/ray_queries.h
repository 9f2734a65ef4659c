// Arbitrary rays against the finest terrain and objects, and where landmarks appear: POST /v1/rays and POST
// /v1/project.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "dem/support/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/frame/camera.h"
#include "engine/frame/objects.h"
#include "engine/frame/pose.h"
#include "engine/frame/queries.h"
#include "engine/frame/shutter.h"
#include "engine/frame/sun.h"
#include "engine/render_cache.h"

namespace selenograph::engine {

// In the caller's task arena. What they throw and answer is what Renderer::cast and Renderer::project do.
std::vector<RayHit> cast_rays(std::span<const Ray> rays, const std::vector<SceneObject>& objects,
                              const std::optional<Sun>& sun, const dem::Terrain& terrain, RenderCache& kept,
                              const StopToken& stop);
std::vector<Landmark> project_landmarks(const Camera& camera, const Pose& pose, const std::optional<Shutter>& shutter,
                                        std::span<const LandmarkQuery> points, const std::vector<SceneObject>& objects,
                                        const std::optional<Sun>& sun, const dem::Terrain& terrain, RenderCache& kept,
                                        const StopToken& stop);

}  // namespace selenograph::engine
