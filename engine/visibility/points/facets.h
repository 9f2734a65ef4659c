// Sixteen triangles of the mesh, structure of arrays.
#pragma once

#include <cstdint>

#include "engine/scene/mesh.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

struct alignas(64) Facets {
  double a[3][kPacket], b[3][kPacket], c[3][kPacket];                      // vertices, MOON_ME, metres
  float normal_a[3][kPacket], normal_b[3][kPacket], normal_c[3][kPacket];  // vertex normals, for shading
};

inline bool in_one_block(const TriangleId ids[kPacket]) {
  std::uint32_t other = 0;
  for (int i = 0; i < kPacket; ++i) other |= ids[i].packed() ^ ids[0].packed();
  return TriangleId(other).block() == 0;
}

// For a mesh with triangles. The vertices equal those of Mesh::triangle, bit for bit.
void gather(const Mesh& mesh, const TriangleId ids[kPacket], Facets& out);

}  // namespace selenograph::engine
