// What shades: from a packet's surface points to its radiance.
#pragma once

#include <optional>

#include "engine/camera/row_views.h"
#include "engine/frame/report.h"
#include "engine/frame/request.h"
#include "engine/radiometry/brdf.h"
#include "engine/radiometry/mapped_surface.h"
#include "engine/support/packet.h"
#include "engine/visibility/points/facets.h"

namespace selenograph::engine {

class PacketShader {
 public:
  // `request` and `views` outlive it.
  PacketShader(const FrameRequest& request, const RowViews& views, const RadianceTerms& terms);

  // Unit normals and cosines to Sun and camera.
  void shade(const Facets& facets, const SurfacePoints& points, const Rays& rays, Shading& out) const;

  // Per lane, W m-2 sr-1, eq. (1). `lit`: how much of the Sun each point sees. `base`: what is left without the Sun;
  // written where a map decides, else it is base_radiance() everywhere. `sampler`: the calling task's own.
  // `first_row`: of a square packet, where rows have views of their own.
  using Sampler = MappedSurface::Sampler;
  void radiances(const SurfacePoints& points, const Shading& shading, const Rays& rays, const float* lit,
                 Sampler& sampler, float* out, float* base, int first_row = 0) const;
  Sampler sampler(const StopToken& stop) const { return mapped_ ? mapped_->sampler(stop) : Sampler(); }
  // Whether base radiance is another at every place.
  bool bases_vary() const { return mapped_ && mapped_->emits(); }
  float base_radiance() const { return base_; }

 private:
  const FrameRequest& request_;
  double irradiance_;
  float base_;
  Brdf brdf_;
  std::optional<MappedSurface> mapped_;
};

}  // namespace selenograph::engine
