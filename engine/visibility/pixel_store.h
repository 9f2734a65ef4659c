// What sixteen pixels go through whichever way they are seen: where they look, how they are lit, where it is stored.
#pragma once

#include <cstdint>
#include <mutex>
#include <vector>

#include "engine/camera/pixel_rays.h"
#include "engine/camera/view.h"
#include "engine/frame/report.h"
#include "engine/frame/request.h"
#include "engine/radiometry/brdf.h"
#include "engine/radiometry/mapped_surface.h"
#include "engine/visibility/facets.h"
#include "engine/visibility/frame_sources.h"
#include "engine/visibility/refine.h"
#include "engine/visibility/render_pass.h"

namespace selenograph::engine {

// How they lie together: rays that are traced are bundled best in a square, pixels drawn lie in a row.
enum class Shape { square, row };
inline constexpr int kPacketSide = 4;
static_assert(kPacketSide * kPacketSide == kPacket);

// A sub-pixel sample of every pixel, at an offset from its centre: geometry is stored if asked for, radiance added with
// a weight, light looked for where either wants it, hits counted once.
struct Layer {
  double dx, dy;
  bool store;
  float weight;
  bool light, count;
};

// Where radiance is added with a weight, if that isn't 0, and, unless null, what of it is left without the Sun.
struct Target {
  std::vector<float>& radiance;
  float weight;
  std::vector<float>* bases;
};

// Shading's view of a packet, per lane.
struct alignas(64) Shading {
  double nx[kPacket], ny[kPacket],
      nz[kPacket];                   // unit smooth normal: vertex normals weighted by the place in the triangle
  double mu0[kPacket], mu[kPacket];  // cosines of incidence and emission
  Vec3 normal(int i) const { return {nx[i], ny[i], nz[i]}; }
};

class ObjectsInFrame;
struct ObjectLanes;

class PixelStore {
 public:
  // Sizes and initialises the products that are asked for. `rays`: of the pixels' centres, where there is distortion.
  PixelStore(const Mesh& mesh, const View& view, const FrameRequest& request, const RadianceTerms& radiance,
             const PixelRays& rays, FrameSources& sources, FrameProducts& out);

  const FrameRequest& request() const { return request_; }
  const View& view() const { return view_; }
  const Mesh& mesh() const { return mesh_; }
  FrameProducts& out() const { return out_; }
  bool wants_geometry() const { return wants_geometry_; }
  bool wants_light() const { return wants_light_; }
  std::vector<Layer> layers() const;

  // Rays of the packet whose first pixel is (x, y). `rays`: of the layer, where there is distortion; else they are
  // solved for here, or known.
  void aim(Shape shape, int x, int y, const Layer& layer, const PixelRays* rays, Rays& out) const;
  const PixelRays& centres() const { return centres_; }

  void shade(const Facets& facets, const SurfacePoints& points, const Rays& rays, Shading& out) const;
  // `sampler`: of the task that calls; `base`: written where the ground is mapped.
  using Sampler = MappedSurface::Sampler;
  Sampler sampler() const { return mapped_ ? mapped_->sampler() : Sampler(); }
  bool mapped() const { return mapped_.has_value(); }
  void radiances(const SurfacePoints& points, const Shading& shading, const Rays& rays, const float* lit,
                 Sampler& sampler, float* out, float* base) const;
  // What is hit has this without sunlight.
  float base_radiance() const { return base_; }

  // Lanes at once but for those on quads of several sources, which are left: a bit for each.
  std::uint32_t account_all(const SurfacePoints& points, std::uint32_t hits, PassCounts* counts) const;
  // One lane; `counts` may be null.
  void account(const SurfacePoints& points, int lane, std::size_t pixel, PassCounts* counts) const;
  void store_geometry(const SurfacePoints& points, int lane, const Vec3& direction, const Shading& shading, float lit,
                      std::size_t pixel) const;
  // Lanes that see an object, of the packet that begins at pixel (x, y).
  void store_objects(const ObjectsInFrame& objects, const ObjectLanes& lanes, const Rays& rays, const float* lit,
                     Shape shape, int x, int y, const Layer& layer, const Target& target, PassCounts* counts) const;

  void merge(const PassCounts& counts);
  PassCounts take_total() { return std::move(total_); }

 private:
  // Of terrain or of an object; `spacing_m`: NaN on an object.
  void store_point(const SurfacePoints& points, int lane, const Vec3& direction, const Shading& shading, float lit,
                   float spacing_m, std::size_t pixel) const;
  float direct(const Shading& shading, const Vec3& direction, float lit, int lane) const;
  template <Shape shape>
  void aim_shape(int x, int y, const Layer& layer, const PixelRays* rays, Rays& out) const;

  const Mesh& mesh_;
  const View& view_;
  const FrameRequest& request_;
  const PixelRays& centres_;
  FrameSources& sources_;
  FrameProducts& out_;
  double irradiance_;
  float base_;
  Brdf brdf_;
  std::optional<MappedSurface> mapped_;
  bool wants_radiance_, wants_geometry_, wants_light_, linear_;
  int grid_;
  Vec3 first_, right_, down_;
  std::mutex mutex_;
  PassCounts total_;
};

}  // namespace selenograph::engine
