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

// Gathers the vertices of sixteen triangles. They equal those of Mesh::triangle bit for bit.
void gather(const Mesh& mesh, const TriangleId ids[kPacket], Facets& out);

// Factors of the albedo at the vertices of sixteen triangles, times dem::kBrightnessOfOne (Block::brightness).
struct alignas(64) VertexBrightness {
  std::int32_t a[kPacket], b[kPacket], c[kPacket];
};
void gather_brightness(const Mesh& mesh, const TriangleId ids[kPacket], VertexBrightness& out);
// Interpolates the factor of the albedo between vertices. `v`, `w`: weights of the second and third vertex.
void interpolate_brightness(const VertexBrightness& vertices, const float* v, const float* w, float* out);
void interpolate_brightness(const Mesh& mesh, const SurfacePoints& points, float* out);

}  // namespace selenograph::engine
