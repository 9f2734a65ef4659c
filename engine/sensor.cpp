#include "engine/sensor.h"

#include <algorithm>
#include <cmath>

namespace selenograph::engine {

double expose(const ImageSettings& settings, const std::vector<float>& radiance, std::vector<std::uint16_t>& image) {
  const float brightest = radiance.empty() ? 0.F : *std::max_element(radiance.begin(), radiance.end());
  const double full_scale = settings.full_scale_radiance_w_m2_sr.value_or(static_cast<double>(brightest));
  const double top = settings.bit_depth == 16 ? 65535 : 255;
  image.assign(radiance.size(), 0);
  if (!(full_scale > 0)) return full_scale;
  const double scale = top / full_scale;
  for (std::size_t i = 0; i < radiance.size(); ++i)
    image[i] =
        static_cast<std::uint16_t>(std::clamp(std::nearbyint(static_cast<double>(radiance[i]) * scale), 0.0, top));
  return full_scale;
}

}  // namespace selenograph::engine
