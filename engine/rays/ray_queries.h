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

// Both run in the caller's task arena. Results and exceptions are those of Renderer::cast and Renderer::project.
std::vector<RayHit> cast_rays(std::span<const Ray> rays, const std::vector<SceneObject>& objects,
                              const std::optional<Sun>& sun, const dem::Terrain& terrain, RenderCache& cache,
                              const StopToken& stop);
std::vector<Landmark> project_landmarks(const Camera& camera, const Pose& pose, const std::optional<Shutter>& shutter,
                                        std::span<const LandmarkQuery> points, const std::vector<SceneObject>& objects,
                                        const std::optional<Sun>& sun, const dem::Terrain& terrain, RenderCache& cache,
                                        const StopToken& stop);

// Returns the first occluder of each ray toward a distant object: the Moon with its rocks (if `moon`), an object, or
// none. Rays that stay 13 km above the datum, or pass 12 km below it, are decided without terrain: there the Moon
// occludes even where there is no data. `detail_within_m`: farther away the ground is taken without detail, because a
// ray along the horizon would need so many blocks with detail that it takes seconds.
std::vector<HiddenBy> what_hides(std::span<const Ray> rays, const std::vector<SceneObject>& objects, bool moon,
                                 const dem::Terrain& terrain, RenderCache& cache, const StopToken& stop,
                                 double detail_within_m = std::numeric_limits<double>::infinity());

}  // namespace selenograph::engine
