#include "dem/terrain/resampling.h"

#include <algorithm>
#include <cmath>

#include "dem/gdal/raster.h"

namespace selenograph::dem {

ResamplingError resampling_error(const Terrain& terrain, int source, int posts) {
  const RasterInfo& info = terrain.catalogue().rasters()[static_cast<std::size_t>(source)];
  Raster raster(info);
  ResamplingError error;
  double sum2 = 0;  // of squared differences, m^2
  for (int k = 0; k < posts; ++k) {
    // Use the additive recurrence of the plastic number (Roberts 2018): even cover, no alignment with rows or tiles.
    const double u = std::fmod(0.5 + 0.7548776662466927 * k, 1.0), v = std::fmod(0.5 + 0.5698402909980532 * k, 1.0);
    const int x = std::min(static_cast<int>(u * info.width), info.width - 1);
    const int y = std::min(static_cast<int>(v * info.height), info.height - 1);
    float post = 0;
    raster.read(x, y, 1, 1, &post);
    if (std::isnan(post)) continue;
    const Geographic position = place_of_post(info, x, y);
    const HeightAnswer surface = terrain.height(position.lat_deg, position.lon_deg);
    if (std::isnan(surface.height_m) || surface.source != source || surface.blended) continue;
    const double difference = surface.height_m - (static_cast<double>(post) + terrain.catalogue().offset_m(source));
    ++error.posts;
    sum2 += difference * difference;
    error.worst_m = std::max(error.worst_m, std::abs(difference));
  }
  if (error.posts > 0) error.rms_m = std::sqrt(sum2 / error.posts);
  return error;
}

}  // namespace selenograph::dem
