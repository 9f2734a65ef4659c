// Pixels of one frame: visibility, surface points, radiance, in tiles.
#pragma once

#include <cstdint>
#include <vector>

#include "dem/stop_token.h"
#include "engine/camera/view.h"
#include "engine/frame/report.h"
#include "engine/frame/request.h"
#include "engine/visibility/scene.h"

namespace selenograph::engine {

struct PassCounts {
  std::uint64_t hit = 0, missing = 0, filled = 0, on_object = 0;
  double draw_ms = 0, resolve_ms = 0, shadow_ms = 0;  // as in StageTimes
};

class FrameSources;
class ObjectsInFrame;
struct FrameScratch;
struct PixelRays;

// Fills the products that are asked for, sized and initialised here. `source` holds the numbers of `sources`
// until that settles them. `rays`: of the pixels' centres, where the camera has distortion. Parallel over tiles of
// pixels in the caller's task arena; stops between tiles.
PassCounts render_pixels(const Scene& scene, const View& view, const FrameRequest& request,
                         const RadianceTerms& radiance, const PixelRays& rays, const ObjectsInFrame& objects,
                         FrameSources& sources, const StopToken& stop, FrameScratch& scratch, FrameProducts& products);

}  // namespace selenograph::engine
