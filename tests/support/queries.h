// The engine's entry functions, called through a renderer without a deadline.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "engine/lidar/lidar_scan.h"
#include "engine/limb/limb_in_view.h"
#include "engine/maps/render_map.h"
#include "engine/rays/ray_queries.h"
#include "engine/renderer.h"
#include "engine/sky/sky_in_view.h"

namespace selenograph::test {

using DetailPointer = std::shared_ptr<const dem::Detail>;

inline std::vector<engine::RayHit> cast_rays(const engine::Renderer& renderer, std::span<const engine::Ray> rays,
                                             const std::optional<engine::Sun>& sun = {},
                                             const std::vector<engine::SceneObject>& objects = {},
                                             const DetailPointer& detail = {}) {
  return renderer.query(
      detail, {}, [&](const engine::RenderContext& context) { return engine::cast_rays(rays, objects, sun, context); });
}

// Projects landmarks into the image of a request's camera, with its objects and detail.
inline std::vector<engine::Landmark> project_landmarks(const engine::Renderer& renderer,
                                                       const engine::FrameRequest& request,
                                                       std::span<const engine::LandmarkQuery> points,
                                                       const std::optional<engine::Sun>& sun = {}) {
  return renderer.query(request.detail, {}, [&](const engine::RenderContext& context) {
    return engine::project_landmarks(request.camera, request.pose, request.shutter, points, request.objects, sun,
                                     context);
  });
}

inline engine::LidarReturns scan_lidar(const engine::Renderer& renderer, const engine::LidarRequest& request) {
  return renderer.query(request.scenery.detail, {},
                        [&](const engine::RenderContext& context) { return engine::scan_lidar(request, context); });
}

inline std::vector<engine::SkyObject> query_sky(const engine::Renderer& renderer, const engine::FrameRequest& request) {
  return renderer.query(request.detail, {},
                        [&](const engine::RenderContext& context) { return engine::query_sky(request, context); });
}

inline std::vector<engine::LimbPoint> find_limb(const engine::Renderer& renderer, const engine::LimbRequest& request) {
  return renderer.query({}, {},
                        [&](const engine::RenderContext& context) { return engine::find_limb(request, context); });
}

inline std::vector<engine::TerminatorPoint> find_terminator(const engine::Renderer& renderer,
                                                            const engine::LimbRequest& request) {
  return renderer.query(
      {}, {}, [&](const engine::RenderContext& context) { return engine::find_terminator(request, context); });
}

inline engine::Map render_map(const engine::Renderer& renderer, const engine::MapRequest& request,
                              const StopToken& stop = {}, const engine::MapProgress& progress = {}) {
  return renderer.query(request.scenery.detail, stop, [&](const engine::RenderContext& context) {
    return engine::render_map(request, context, progress);
  });
}

}  // namespace selenograph::test
