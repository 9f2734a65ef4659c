#include "engine/visibility/image/frame_job.h"

#include <cmath>

#include "engine/frame/needs.h"

namespace selenograph::engine {

std::vector<SubpixelSample> samples_of(const FrameRequest& request) {
  const bool radiance = wants_radiance(request);
  const bool geometry = wants_geometry(request);
  const int side = static_cast<int>(std::lround(std::sqrt(request.accuracy.samples_per_pixel)));
  if (side == 1) return {{0, 0, true, radiance ? 1.F : 0.F, wants_light(request), true}};
  std::vector<SubpixelSample> samples;
  if (geometry) samples.push_back({0, 0, true, 0.F, wants_light_at_centres(request), true});
  if (!radiance) return samples;
  const float weight = 1.F / static_cast<float>(side * side);
  for (int j = 0; j < side; ++j)
    for (int i = 0; i < side; ++i)
      samples.push_back({(i + 0.5) / side - 0.5, (j + 0.5) / side - 0.5, false, weight, true, samples.empty()});
  return samples;
}

}  // namespace selenograph::engine
