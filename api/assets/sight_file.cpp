#include "api/assets/sight_file.h"

#include <fmt/format.h>

#include <vector>

#include "api/encode/image_library.h"
#include "dem/base/error.h"

namespace selenograph::api {

engine::SightTable read_sight_file(const std::string& path, const std::string& name, std::size_t max_bytes) {
  std::size_t width = 0, height = 0;
  std::vector<Vec3> directions;
  image_library().read(path, [&](const ImageSize& size) {
    if (size.channels != 3 || !size.is_floating_point)
      throw DataError(path,
                      fmt::format("has {} samples a pixel of type {}; lines of sight are three floating-point numbers",
                                  size.channels, size.type));
    width = size.width;
    height = size.height;
    if (width > max_bytes / sizeof(Vec3) / height)
      throw DataError(path,
                      fmt::format("has {} x {} lines of sight, more than fit in --mesh-mb; a lattice of every 8th "
                                  "pixel is usually enough",
                                  width, height));
    directions.resize(width * height);
    static_assert(sizeof(Vec3) == 3 * sizeof(double));
    return directions.front().data();
  });
  return engine::SightTable(name, width, height, directions, path);
}

}  // namespace selenograph::api
