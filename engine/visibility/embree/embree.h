// Embree behind one pair of files, for versions 3.13 and 4: no other file includes its headers or names its types.
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>

#include "dem/support/stop_token.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// Sixteen rays, structure of arrays; relative to the scene's anchor, metres.
struct alignas(64) RayPacket {
  float ox[kPacket], oy[kPacket], oz[kPacket];
  float dx[kPacket], dy[kPacket], dz[kPacket];
  std::int32_t active[kPacket];  // -1: to be traced, 0: not
  float near[kPacket] = {};      // where to start looking, in units of the direction's length
};

// What each ray of a packet meets first.
struct alignas(64) RayHits {
  static constexpr std::uint32_t kNone = ~0U;
  std::uint32_t geometry[kPacket];              // kNone: nothing, or not active; the rest is then undefined
  std::uint32_t primitive[kPacket];             // triangle of the geometry
  std::uint32_t instance[kPacket];              // geometry of this scene that the other one's geometry is of, or kNone
  float u[kPacket], v[kPacket];                 // over the whole grid, or barycentric in a triangle
  float distance[kPacket];                      // in units of the direction's length
  float nx[kPacket], ny[kPacket], nz[kPacket];  // geometric normal, not normalised
};

// Triangles that the rays of a packet have come upon on their way, structure of arrays.
struct Occluders {
  std::size_t count;
  const float *nx, *ny, *nz;  // geometric normal, not normalised
  const float* distance;      // along the ray, in units of the direction's length
  std::int32_t* valid;        // -1: blocks the ray, 0: doesn't
};

class EmbreeScene {
 public:
  // Says which occluders don't count by setting their `valid` to 0. Called by whoever calls occluded(), often.
  using Filter = std::function<void(const Occluders&)>;
  enum class Filters { none, on_occlusion };
  // Whether a packet is traced as one bundle: when its directions allow it, unchecked, or never.
  enum class Bundles { where_safe, always, never };

  // `threads` that build it, 0: all cores. Devices live as long as the process, one per number of threads.
  EmbreeScene(std::size_t geometries, int threads, Filters filters);
  ~EmbreeScene();
  EmbreeScene(const EmbreeScene&) = delete;
  EmbreeScene& operator=(const EmbreeScene&) = delete;

  // Geometries by index, safe to call concurrently for different ones; one that is never set is empty. The functions
  // write x, y, z of each vertex and the vertices of each triangle.
  void set_grid(std::size_t geometry, int side, const std::function<void(std::span<float>)>& vertices);
  void set_triangles(std::size_t geometry, std::size_t vertex_count, std::size_t triangle_count,
                     const std::function<void(std::span<float>)>& vertices,
                     const std::function<void(std::span<std::uint32_t>)>& triangles);
  // Another scene, built before, which outlives this one and has as many threads.
  void set_instance(std::size_t geometry, const EmbreeScene& of, const Eigen::Affine3f& place);
  // Builds the acceleration structure once all geometries are set, in the caller's task arena. Throws
  // std::runtime_error when that fails: for want of memory, most likely; Cancelled when `stop` says so.
  void build(const StopToken& stop = {});

  // After build(), safe to call concurrently.
  void intersect(const RayPacket& rays, RayHits& hits, Bundles bundles = Bundles::where_safe) const;
  // blocked[i]: something that counts stands in the active ray's way. `filter` has a say in scenes with filters.
  void occluded(const RayPacket& rays, bool blocked[kPacket], const Filter& filter = {},
                Bundles bundles = Bundles::where_safe) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace selenograph::engine
