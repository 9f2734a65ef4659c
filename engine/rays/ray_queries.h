// Intersects arbitrary rays with the finest terrain and objects, and finds landmarks in an image: POST /v1/rays and
// POST /v1/project.
#pragma once

#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/cache/render_cache.h"
#include "engine/frame/camera.h"
#include "engine/frame/objects.h"
#include "engine/frame/pose.h"
#include "engine/frame/queries.h"
#include "engine/frame/shutter.h"
#include "engine/frame/sky.h"
#include "engine/frame/sun.h"

namespace selenograph::engine {

// Run in the caller's task arena; results and exceptions are those of Renderer::cast and Renderer::project.
std::vector<RayHit> cast_rays(std::span<const Ray> rays, const std::vector<SceneObject>& objects,
                              const std::optional<Sun>& sun, const dem::Terrain& terrain, RenderCache& kept,
                              const StopToken& stop);
std::vector<Landmark> project_landmarks(const Camera& camera, const Pose& pose, const std::optional<Shutter>& shutter,
                                        std::span<const LandmarkQuery> points, const std::vector<SceneObject>& objects,
                                        const std::optional<Sun>& sun, const dem::Terrain& terrain, RenderCache& kept,
                                        const StopToken& stop);

// The first occluder of each ray toward a distant object: the Moon with its rocks (unless there is no `moon`), an
// object, or nothing. Rays that pass 13 km above the datum or 12 km below it, beyond all terrain, cost next to nothing:
// below it the Moon hides what is behind it even where there is no data. `detail_within_m`: beyond it the ground counts
// without its detail, of which a ray along the horizon meets so much that it takes seconds.
std::vector<HiddenBy> what_hides(std::span<const Ray> rays, const std::vector<SceneObject>& objects, bool moon,
                                 const dem::Terrain& terrain, RenderCache& kept, const StopToken& stop,
                                 double detail_within_m = std::numeric_limits<double>::infinity());

}  // namespace selenograph::engine
