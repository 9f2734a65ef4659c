// Input of the per-pixel stages of one frame.
#pragma once

#include <functional>
#include <vector>

#include "dem/base/stop_token.h"
#include "engine/camera/pixel_rays.h"
#include "engine/camera/row_views.h"
#include "engine/frame/report.h"
#include "engine/frame/request.h"
#include "engine/indirect/terrain_light.h"
#include "engine/visibility/objects/objects_in_frame.h"
#include "engine/visibility/points/scene.h"

namespace selenograph::engine {

// One sample of every pixel, at the offset (dx, dy) from its centre. store: geometry products are written; weight: of
// its radiance; light: sunlight is needed; count: hits are counted.
struct SubpixelSample {
  double dx, dy;
  bool store;
  float weight;
  bool light, count;
};
// Called for each sample with a weight, one after the other, with the radiance of all pixels.
using EachSample = std::function<void(const SubpixelSample& sample, const std::vector<float>& radiance)>;

struct FrameJob {
  const FrameRequest& request;
  const RowViews& views;
  const Scene& scene;
  const ObjectsInFrame& objects;
  const RadianceTerms& radiance;  // terms of the terrain
  const PixelRays& centres;       // rays of the pixel centres, for a camera with distortion
  const StopToken& stop;
  const EachSample& each;                  // may be empty
  const TerrainLight* indirect = nullptr;  // null: no indirect light
  const RowViews* flow_to = nullptr;       // the other image of the product `flow`
};

std::vector<SubpixelSample> samples_of(const FrameRequest& request);

}  // namespace selenograph::engine
