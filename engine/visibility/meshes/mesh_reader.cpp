// A shape as bytes, from the child to its parent, which is the same executable:
//
//   | Header | corners | triangles | names of parts, each with a final zero |
#include "engine/visibility/meshes/mesh_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <string_view>

#include "dem/base/error.h"
#include "dem/files/files.h"
#include "engine/visibility/meshes/mesh_file.h"
#include "engine/visibility/objects/object_mesh.h"

namespace selenograph::engine {
namespace {

struct Header {
  std::size_t corners, triangles, textured;
};

std::string encode_shape(const ObjectShape& shape) {
  const Header header{shape.corners.size(), shape.triangles.size(), shape.textured};
  std::string bytes(reinterpret_cast<const char*>(&header), sizeof header);
  bytes.reserve(sizeof header + shape.bytes());
  bytes.append(reinterpret_cast<const char*>(shape.corners.data()), header.corners * sizeof(ObjectCorner));
  bytes.append(reinterpret_cast<const char*>(shape.triangles.data()), header.triangles * sizeof(ObjectTriangle));
  for (const std::string& part : shape.parts) bytes.append(part.c_str(), part.size() + 1);
  return bytes;
}

// Moves the first `count` items from `bytes` to `items`. Returns false if there are fewer.
template <typename T>
bool take(std::string_view& bytes, std::size_t count, std::vector<T>& items) {
  if (count > bytes.size() / sizeof(T)) return false;
  items.resize(count);
  if (count > 0) std::memcpy(static_cast<void*>(items.data()), bytes.data(), count * sizeof(T));
  bytes.remove_prefix(count * sizeof(T));
  return true;
}

// Throws DataError if the bytes are not those of a shape: a damaged file may make the library write anywhere.
ObjectShape shape_of(std::string_view bytes, const std::string& path) {
  ObjectShape shape;
  std::vector<Header> header;
  const bool is_whole = take(bytes, 1, header) && take(bytes, header[0].corners, shape.corners) &&
                        take(bytes, header[0].triangles, shape.triangles);
  while (is_whole && bytes.find('\0') != std::string_view::npos) {
    shape.parts.emplace_back(bytes.substr(0, bytes.find('\0')));
    bytes.remove_prefix(shape.parts.back().size() + 1);
  }
  const auto is_finite = [](const ObjectCorner& c) { return c.place.is_finite() && c.normal.is_finite(); };
  const auto is_inside = [&](const ObjectTriangle& t) {
    return std::ranges::max(t.corner) < shape.corners.size() && t.part < shape.parts.size();
  };
  if (!is_whole || !bytes.empty() || shape.triangles.empty() || !std::ranges::all_of(shape.corners, is_finite) ||
      !std::ranges::all_of(shape.triangles, is_inside))
    throw DataError(path, "cannot be read: the answer of its reader is damaged");
  shape.textured = header[0].textured != 0;
  return shape;
}

}  // namespace

int read_mesh_in_child(int argc, char** argv) {
  return read_in_child(argc, argv, [](const std::string& path, std::size_t max_bytes) {
    const std::string extension = std::filesystem::path(path).extension().string();
    return encode_shape(read_mesh_file(dem::read_head(path, max_bytes), extension.substr(1), max_bytes));
  });
}

ObjectShape read_mesh(const ConfinedReader& reader, const std::string& path, const StopToken& stop) {
  ObjectShape shape = shape_of(reader.read(kReadMeshCommand, path, stop), path);
  const std::size_t bytes = ObjectMesh::bytes_for(shape), max_bytes = reader.options().max_bytes;
  if (bytes > max_bytes)
    throw DataError(path, fmt::format("has {} triangles, which take {} MiB: more than the {} of a mesh",
                                      shape.triangles.size(), bytes >> 20, max_bytes >> 20));
  return shape;
}

}  // namespace selenograph::engine
