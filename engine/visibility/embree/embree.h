// Wraps Embree 3.13 and 4: no other file includes its headers or names its types.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>

#include "dem/base/stop_token.h"
#include "engine/support/affine.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// Sixteen rays, structure of arrays, relative to the scene's anchor, metres.
struct alignas(64) RayPacket {
  float ox[kPacket], oy[kPacket], oz[kPacket];
  float dx[kPacket], dy[kPacket], dz[kPacket];
  std::int32_t active[kPacket];  // -1: active, 0: not
  float near[kPacket] = {};      // start of the ray, in lengths of its direction
};

// First hit of each ray of a packet.
struct alignas(64) RayHits {
  static constexpr std::uint32_t kNone = ~0U;
  std::uint32_t geometry[kPacket];   // kNone: no hit, or the lane is not active; the other members are then undefined
  std::uint32_t primitive[kPacket];  // triangle of the geometry
  std::uint32_t instance[kPacket];   // geometry of this scene that is an instance, or kNone
  float u[kPacket], v[kPacket];      // over the whole grid, or barycentric in a triangle
  float distance[kPacket];           // in lengths of the direction
  float nx[kPacket], ny[kPacket], nz[kPacket];  // geometric normal, not normalised
};

// Candidate occluders of a packet's rays, structure of arrays.
struct Occluders {
  std::size_t count;
  const float *nx, *ny, *nz;  // geometric normal, not normalised
  const float* distance;      // along the ray, in lengths of its direction
  const std::uint32_t* ray;   // lane in the packet; if count is kPacket, entry i is lane i
  std::int32_t* valid;        // -1: blocks the ray, 0: does not
};

class EmbreeScene {
 public:
  // Rejects occluders by setting their `valid` to 0. Called often, by the thread that called occluded().
  using Filter = std::function<void(const Occluders&)>;
  enum class Filters { none, on_occlusion };
  // Tracing of a packet as one coherent bundle: if its directions allow it, always (unchecked), or never.
  enum class Bundles { where_safe, always, never };

  // `threads`: number of threads for building, 0: all cores. Devices live as long as the process, one per number of
  // threads.
  EmbreeScene(std::size_t geometries, int threads, Filters filters);
  ~EmbreeScene();
  EmbreeScene(const EmbreeScene&) = delete;
  EmbreeScene& operator=(const EmbreeScene&) = delete;

  // Sets a geometry by its index; thread-safe for different indices. A geometry that is never set is empty. The
  // callbacks write x, y, z of each vertex and the vertex indices of each triangle.
  void set_grid(std::size_t geometry, int side, const std::function<void(std::span<float>)>& vertices);
  void set_triangles(std::size_t geometry, std::size_t vertex_count, std::size_t triangle_count,
                     const std::function<void(std::span<float>)>& vertices,
                     const std::function<void(std::span<std::uint32_t>)>& triangles);
  // Adds an instance of another scene, which must be built, use the same number of threads, and outlive this one.
  void set_instance(std::size_t geometry, const EmbreeScene& of, const Affine& scene_from_instance);
  // Builds the acceleration structure after all geometries are set, in the caller's task arena. Throws
  // std::runtime_error when that fails, most likely for lack of memory; Cancelled when `stop` says so.
  void build(const StopToken& stop = {});

  // Call after build(); thread-safe.
  void intersect(const RayPacket& rays, RayHits& hits, Bundles bundles = Bundles::where_safe) const;
  // Sets blocked[i] if an occluder that the filter accepts blocks the active ray. `filter` is called only in scenes
  // with filters.
  void occluded(const RayPacket& rays, bool blocked[kPacket], const Filter& filter = {},
                Bundles bundles = Bundles::where_safe) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace selenograph::engine
