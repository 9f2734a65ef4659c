#include "api/assets/sight_file.h"

#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <vector>

#include "dem/base/error.h"

namespace selenograph::api {

engine::SightTable read_sight_file(const std::string& path, const std::string& name, std::size_t max_bytes) {
  const auto input = OIIO::ImageInput::open(path);
  if (!input) throw DataError(path, fmt::format("cannot be read as an image: {}", OIIO::geterror()));
  const OIIO::ImageSpec& spec = input->spec();
  if (spec.nchannels != 3 || !spec.format.is_floating_point())
    throw DataError(path,
                    fmt::format("has {} samples a pixel of type {}; lines of sight are three floating-point numbers",
                                spec.nchannels, spec.format.c_str()));
  const auto width = static_cast<std::size_t>(spec.width), height = static_cast<std::size_t>(spec.height);
  if (width > max_bytes / sizeof(Vec3) / height)
    throw DataError(path, fmt::format("has {} x {} lines of sight, more than fit in --mesh-mb; a lattice of every 8th "
                                      "pixel is usually enough",
                                      width, height));
  std::vector<Vec3> directions(width * height);
  static_assert(sizeof(Vec3) == 3 * sizeof(double));
  if (!input->read_image(0, 0, 0, 3, OIIO::TypeDesc::DOUBLE, directions.data()))
    throw DataError(path, fmt::format("cannot be read: {}", input->geterror()));
  return engine::SightTable(name, width, height, directions, path);
}

}  // namespace selenograph::api
