// Packets of sixteen pixels, structure of arrays: rays, surface points, and shading geometry.
#pragma once

#include <cstdint>
#include <cstring>

#include "dem/grid/geodesy.h"
#include "engine/support/triangle_id.h"

namespace selenograph::engine {

inline constexpr int kPacket = 16;

// Sixteen rays. Directions need not be unit vectors: distances are in units of their lengths.
struct alignas(64) Rays {
  double ox[kPacket], oy[kPacket], oz[kPacket];  // MOON_ME, m
  double dx[kPacket], dy[kPacket], dz[kPacket];
  bool valid[kPacket];
  Vec3 origin(int i) const { return {ox[i], oy[i], oz[i]}; }
  Vec3 direction(int i) const { return {dx[i], dy[i], dz[i]}; }
  void set(int i, const Vec3& o, const Vec3& d) {
    ox[i] = o.x();
    oy[i] = o.y();
    oz[i] = o.z();
    dx[i] = d.x();
    dy[i] = d.y();
    dz[i] = d.z();
    valid[i] = true;
  }
};

struct alignas(64) SurfacePoints {
  double x[kPacket], y[kPacket], z[kPacket];     // MOON_ME, m
  double distance[kPacket];                      // along the ray, in lengths of its direction
  double v[kPacket], w[kPacket];                 // barycentric weights of the triangle's second and third vertex
  double nx[kPacket], ny[kPacket], nz[kPacket];  // the facet's outward normal, not normalised
  TriangleId triangle[kPacket];                  // a valid triangle even without a hit
  bool hit[kPacket];
  bool toward_moon[kPacket];  // no hit, but the ray meets a sphere below the scene (Scene::core_m): no data
  Vec3 position(int i) const { return {x[i], y[i], z[i]}; }
  Vec3 facet_normal(int i) const { return {nx[i], ny[i], nz[i]}; }  // its length is twice the facet's area
};

struct alignas(64) Shading {
  double nx[kPacket], ny[kPacket],
      nz[kPacket];                   // unit shading normal: interpolated vertex normals
  double mu0[kPacket], mu[kPacket];  // cosines of incidence and emission
  double incident[kPacket];          // mean cosine of incidence of the arriving sunlight; point Sun: mu0
  Vec3 normal(int i) const { return {nx[i], ny[i], nz[i]}; }
};

// Returns a bit per lane that hits.
inline constexpr std::uint32_t kAllLanes = 0xffff;
inline std::uint32_t hit_bits(const SurfacePoints& points) {
  // Pack eight bools at a time: each is a byte of 0 or 1, and the product moves them next to each other into the top
  // byte.
  static_assert(sizeof(bool) == 1 && kPacket == 16);
  const auto eight = [](const bool* hit) {
    std::uint64_t bytes;
    std::memcpy(&bytes, hit, sizeof bytes);
    return static_cast<std::uint32_t>(bytes * 0x0102040810204080U >> 56);
  };
  return eight(points.hit) | eight(points.hit + 8) << 8;
}

// Returns true if sixteen triangles are of one block: their ids differ only in the bits below the block's.
inline bool in_one_block(const TriangleId ids[kPacket]) {
  std::uint32_t differing_bits = 0;
  for (int i = 0; i < kPacket; ++i) differing_bits |= ids[i].packed() ^ ids[0].packed();
  return TriangleId(differing_bits).block() == 0;
}

}  // namespace selenograph::engine
