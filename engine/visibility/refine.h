// From "which triangle" in float to "exactly where" in double, sixteen rays at a time.
#pragma once

#include <cstdint>
#include <cstring>

#include "engine/visibility/facets.h"

namespace selenograph::engine {

// Sixteen rays in double, structure of arrays. Directions need not be unit: distances come in their lengths.
struct alignas(64) Rays {
  double ox[kPacket], oy[kPacket], oz[kPacket];  // MOON_ME, m
  double dx[kPacket], dy[kPacket], dz[kPacket];
  bool valid[kPacket];
  Vec3 origin(int i) const { return {ox[i], oy[i], oz[i]}; }
  Vec3 direction(int i) const { return {dx[i], dy[i], dz[i]}; }
  void set(int i, const Vec3& o, const Vec3& d) {
    ox[i] = o.x(), oy[i] = o.y(), oz[i] = o.z(), dx[i] = d.x(), dy[i] = d.y(), dz[i] = d.z(), valid[i] = true;
  }
};

// Sixteen points on the surface.
struct alignas(64) SurfacePoints {
  double x[kPacket], y[kPacket], z[kPacket];     // MOON_ME, m
  double distance[kPacket];                      // along the ray, in its direction's lengths
  double v[kPacket], w[kPacket];                 // barycentric weights of the triangle's second and third vertex
  double nx[kPacket], ny[kPacket], nz[kPacket];  // the triangle's outward normal, not normalised
  TriangleId triangle[kPacket];                  // some triangle, too, where there's no hit
  bool hit[kPacket];
  bool toward_moon[kPacket];  // no hit, but the ray meets the datum sphere: for want of data
  Vec3 position(int i) const { return {x[i], y[i], z[i]}; }
  Vec3 facing(int i) const { return {nx[i], ny[i], nz[i]}; }
};

// A bit for each lane that hits.
inline std::uint32_t hit_bits(const SurfacePoints& points) {
  // Eight bools at a time: each is a byte of 0 or 1, and the product moves them next to each other into the top byte.
  static_assert(sizeof(bool) == 1 && kPacket == 16);
  const auto eight = [](const bool* hit) {
    std::uint64_t bytes;
    std::memcpy(&bytes, hit, sizeof bytes);
    return static_cast<std::uint32_t>(bytes * 0x0102040810204080U >> 56);
  };
  return eight(points.hit) | eight(points.hit + 8) << 8;
}

// Where hit[i] and triangle[i] are set: the ray's point on that triangle, or on its neighbour where float rounding
// chose the wrong side of an edge. Takes the hit back when the ray meets the surface from below (it came through a hole
// in the data).
// `facets`: the triangles that the points are on, at last.
void refine(const Mesh& mesh, const Rays& rays, SurfacePoints& points, Facets& facets);

// Whether a place next to a triangle of the mesh lies below the surface.
bool buried(const Mesh& mesh, const TriangleId& beside, const Vec3& place);

// The unit normal that shading uses at a point: those of the triangle's vertices (dem/shading_normals.h), weighted by
// its place. Where that leans away from whoever looks along `direction`, who sees the facet all the same: the facet's.
Vec3 shading_normal(const Mesh& mesh, const SurfacePoints& points, int lane, const Vec3& direction);

}  // namespace selenograph::engine
