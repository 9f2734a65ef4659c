#include "api/assets/sight_file.h"

#include <fmt/format.h>

#include <cstring>
#include <vector>

#include "api/encode/image_library.h"
#include "dem/base/error.h"

namespace selenograph::api {
namespace {

// Header of the bytes from the child; the samples follow as doubles.
struct Header {
  std::size_t columns, rows;
};

std::string read_directions(const std::string& path, std::size_t max_bytes) {
  std::string bytes;
  image_library().read(path, [&](const ImageSize& size) {
    if (size.channels != 3 || !size.is_floating_point)
      throw DataError(path,
                      fmt::format("has {} samples a pixel of type {}; lines of sight are three floating-point numbers",
                                  size.channels, size.type));
    if (size.width > max_bytes / sizeof(Vec3) / size.height)
      throw DataError(path,
                      fmt::format("has {} x {} lines of sight, more than fit in --mesh-mb; a lattice of every 8th "
                                  "pixel is usually enough",
                                  size.width, size.height));
    const Header header{size.width, size.height};
    bytes.resize(sizeof header + size.width * size.height * sizeof(Vec3));
    std::memcpy(bytes.data(), &header, sizeof header);
    return reinterpret_cast<double*>(bytes.data() + sizeof header);
  });
  return bytes;
}

}  // namespace

int read_sights_in_child(int argc, char** argv) {
  image_library();  // loaded before the limit of memory, which counts from what is in use
  return engine::read_in_child(argc, argv, read_directions);
}

engine::SightTable read_sight_file(const engine::ConfinedReader& reader, const std::string& path,
                                   const std::string& name, const StopToken& stop) {
  const std::string bytes = reader.read(kReadSightsCommand, path, stop);
  Header header{};
  std::vector<Vec3> directions(bytes.size() / sizeof(Vec3));
  const std::size_t direction_bytes = directions.size() * sizeof(Vec3);
  if (bytes.size() != sizeof header + direction_bytes) throw DataError(path, "cannot be read as an image");
  std::memcpy(&header, bytes.data(), sizeof header);
  std::memcpy(static_cast<void*>(directions.data()), bytes.data() + sizeof header, direction_bytes);
  return engine::SightTable(name, header.columns, header.rows, directions, path);
}

}  // namespace selenograph::api
