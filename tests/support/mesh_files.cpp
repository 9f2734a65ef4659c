#include "tests/support/mesh_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>

namespace selenograph::test {
namespace {

template <typename T>
std::string bytes_of(T number) {
  return {reinterpret_cast<const char*>(&number), sizeof number};
}

}  // namespace

std::string ply_file(bool binary) {
  std::string file = fmt::format(
      "ply\nformat {} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n"
      "property list uchar int vertex_indices\nend_header\n",
      binary ? "binary_little_endian" : "ascii");
  if (!binary) return file + "0 0 0\n3 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 2 3\n";
  for (const float x : {0.F, 0.F, 0.F, 3.F, 0.F, 0.F, 0.F, 1.F, 0.F, 0.F, 0.F, 1.F}) file += bytes_of(x);
  for (const auto& corners : {std::array{0, 1, 2}, std::array{0, 2, 3}}) {
    file += '\3';
    for (const std::int32_t corner : corners) file += bytes_of(corner);
  }
  return file;
}

std::string gltf_file(const std::string& uri) {
  return R"({
    "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0, "translation": [10, 0, 0], "scale": [2, 2, 2]}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
    "materials": [{"name": "foil"}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}],
    "buffers": [{"byteLength": 36, "uri": ")" +
         uri + R"("}]})";
}

std::string gltf_of_instances(int nodes, int triangles) {
  // A triangle's three corners are bytes: 0, 1, 2 in base64 is AAEC.
  std::string indices, node_list, node_numbers;
  for (int i = 0; i < triangles; ++i) indices += "AAEC";
  for (int i = 0; i < nodes; ++i) {
    node_list += i ? R"(,{"mesh":0})" : R"({"mesh":0})";
    node_numbers += fmt::format("{}{}", i ? "," : "", i);
  }
  return fmt::format(
      R"({{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [{}]}}], "nodes": [{}],
    "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "indices": 1}}]}}],
    "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}},
                  {{"bufferView": 1, "componentType": 5121, "count": {}, "type": "SCALAR"}}],
    "bufferViews": [{{"buffer": 0, "byteLength": 36}}, {{"buffer": 1, "byteLength": {}}}],
    "buffers": [{{"byteLength": 36, "uri": "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}},
                {{"byteLength": {}, "uri": "data:application/octet-stream;base64,{}"}}]}})",
      node_numbers, node_list, 3 * triangles, 3 * triangles, 3 * triangles, indices);
}

std::string mutated(std::string file, std::mt19937& random) {
  const auto below = [&](std::size_t n) { return static_cast<std::size_t>(random() % std::max<std::size_t>(n, 1)); };
  for (std::size_t changes = 1 + below(4); changes > 0; --changes) {
    const std::size_t at = below(file.size()), length = below(std::min<std::size_t>(file.size() - at, 24)) + 1;
    switch (below(8)) {
      case 0:
        file.erase(at, length);
        break;
      case 1:
        file.insert(at, file.substr(at, length));
        break;
      case 2:
        file.resize(at);
        break;
      case 3:  // a number that is too large
        file.replace(at, 1, fmt::format("{}", 1U << below(32)));
        break;
      default:
        if (!file.empty()) file[at] = static_cast<char>(below(2) ? file[at] ^ (1 << below(8)) : random());
    }
  }
  return file;
}

}  // namespace selenograph::test
