// Shading: from a packet's surface points to its radiance.
#pragma once

#include <optional>

#include "engine/camera/packet_rays.h"
#include "engine/camera/row_views.h"
#include "engine/frame/report.h"
#include "engine/frame/request.h"
#include "engine/indirect/terrain_light.h"
#include "engine/radiometry/brdf.h"
#include "engine/radiometry/mapped_surface.h"
#include "engine/support/packet.h"
#include "engine/visibility/points/facets.h"

namespace selenograph::engine {

class PacketShader {
 public:
  // The arguments except `terms` must outlive this object. `indirect`: null if there is no indirect light.
  PacketShader(const FrameRequest& request, const RowViews& views, const Mesh& mesh, const RadianceTerms& terms,
               const TerrainLight* indirect = nullptr);

  // Sets the unit normals and the cosines to Sun and camera.
  void shade(const Facets& facets, const SurfacePoints& points, const Rays& rays, Shading& out) const;

  // Sets `out` to the radiance per lane, W m-2 sr-1, eq. (1). `lit`: share of the Sun that each point sees. `base`:
  // radiance without the Sun, written if it varies; otherwise it is base_radiance() everywhere. `sampler`: that of the
  // calling task. `rows`: rows of the packet, for rows with their own views.
  using Sampler = MappedSurface::Sampler;
  void radiances(const SurfacePoints& points, const Shading& shading, const Rays& rays, const float* lit,
                 Sampler& sampler, float* out, float* base, const PacketRows& rows = {}) const;
  // Sets the ground's albedo per lane: that of the maps or the constant one, times the brightness of made ground.
  // `base`: radiance without the Sun, written if maps give temperatures.
  void albedos(const SurfacePoints& points, const Rays& rays, Sampler& sampler, double* albedo, float* base,
               const PacketRows& rows = {}) const;
  Sampler sampler(const StopToken& stop) const { return mapped_ ? mapped_->sampler(stop) : Sampler(); }
  // Returns whether the radiance without the Sun varies between pixels.
  bool bases_vary() const { return indirect_ || (mapped_ && mapped_->emits()); }
  float base_radiance() const { return base_; }
  // Returns the reflectance of all terrain if it varies at most with the brightness of made ground, and no light varies
  // but the Sun's; else null.
  const Brdf* uniform_brdf() const { return mapped_ || indirect_ ? nullptr : &brdf_; }
  // Returns the albedo that uniform_brdf() is to be given; empty: it has its own.
  std::optional<Albedo> missing_albedo() const { return varied_ ? std::optional(albedo_) : std::nullopt; }
  double irradiance_w_m2() const { return irradiance_; }

 private:
  const FrameRequest& request_;
  double irradiance_;
  float base_;
  Albedo albedo_;
  const Mesh* varied_;  // null: the brightness of made ground is 1 everywhere
  Brdf brdf_;
  std::optional<MappedSurface> mapped_;
  const TerrainLight* indirect_;
};

}  // namespace selenograph::engine
