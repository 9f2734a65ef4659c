// Renders frames by z-buffer and irregular shadow map: strips of the mesh are drawn into tiles of the image, each
// pixel's point is refined in double by the code that ray tracing uses, and shadows are cast on exactly these points.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "dem/base/pool.h"
#include "engine/camera/packet_rays.h"
#include "engine/frame/report.h"
#include "engine/support/stopwatch.h"
#include "engine/visibility/image/frame_job.h"
#include "engine/visibility/image/frame_writer.h"
#include "engine/visibility/points/shading.h"
#include "engine/visibility/zbuffer/image_tiles.h"
#include "engine/visibility/zbuffer/raster_kernels.h"
#include "engine/visibility/zbuffer/row_kernel.h"
#include "engine/visibility/zbuffer/shadow_map.h"

namespace selenograph::engine {

// Scratch memory of a frame, reused from frame to frame.
struct FrameScratch {
  std::vector<StripBox> boxes;
  std::vector<ImageTile> tiles;
  std::vector<LightSamples> samples;  // per tile
  std::vector<float> radiance;        // radiance of the current sub-pixel sample
  std::vector<float> bases;           // radiance without the Sun, per pixel; empty: the same for all pixels
  LightScratch light;
  Pool<TileBuffer> buffers;  // one per thread
  std::size_t bytes() const;
};

class RasterPass {
 public:
  RasterPass(const FrameJob& job, FrameWriter& writer, FrameScratch& scratch, StageTimes& times);

  // One sample of all pixels, on its way through the stages. Between stages a point is only its position in light space
  // (FrameScratch::samples) and its radiance with and without the Sun: the shadow map needs all points before it can
  // answer for any.
  struct Pixels {
    explicit Pixels(const SubpixelSample& of) : sample(of) {}
    const SubpixelSample& sample;
    Stopwatch watch;
  };

  // Calls stages(*this, pixels) for each sample.
  template <typename Stages>
  void for_pixels(const Stages& stages) {
    for (const SubpixelSample& sample : samples_of(request_)) {
      Pixels pixels(sample);
      stages(*this, pixels);
    }
  }

  // The stages, in order. Parallel over tiles in the task arena of the caller; they check the stop token between tiles
  // and between bands of the shadow map.
  void find_points(Pixels& pixels);
  void find_light(Pixels& pixels);
  void find_radiance(Pixels& pixels);
  void write_products(Pixels& pixels);

 private:
  struct Row;        // sixteen pixels of a tile
  struct NearRocks;  // pixels of a tile, collected

  // Resolves the pixels of a tile that has been drawn into `buffer`.
  void resolve_tile(const ImageTile& tile, const TileBuffer& buffer, const SubpixelSample& sample,
                    const PixelRays& lens, PixelCounts& counts, LightSamples& samples);
  // Resolves sixteen pixels from the ids of their triangles: by the row kernel where that is enough, else aims their
  // rays and refines their points.
  void resolve(const Row& row, const std::uint32_t* triangles, NearRocks& near_rocks, PixelCounts& counts,
               LightSamples& samples, PacketShader::Sampler& sampler);
  void resolve_points(const Row& row, Rays& rays, SurfacePoints& points, const Facets& facets,
                      const ResolvedRow& by_kernel, PixelCounts& counts, LightSamples& samples,
                      PacketShader::Sampler& sampler);
  // Resolves light and radiance of the pixels that row_kernel.h can resolve. Returns the lanes that it could resolve
  // but for rocks, which they may show or which may shade them, and sets `places` if there may be any.
  std::uint32_t resolve_by_kernel(const Row& row, const SurfacePoints& points, ResolvedRow& out,
                                  RowPlaces& places) const;
  // Resolves the collected pixels, which are of the row's sample, and empties the collection.
  void resolve_near_rocks(NearRocks& near_rocks, const Row& row, PixelCounts& counts, LightSamples& samples,
                          PacketShader::Sampler& sampler);
  static void store_row(const Row& row, const ResolvedRow& resolved, LightSamples& samples);
  bool needs_points(const Row& row, const SurfacePoints& points, std::uint32_t near_rocks, PixelCounts& counts);
  void shade(std::vector<float>& radiance) const;
  void resolve_objects(const Row& row, Rays& rays, SurfacePoints& points, PixelCounts& counts, LightSamples& samples);
  void store_albedos(const Row& row, const SurfacePoints& points, const Rays& rays, PacketShader::Sampler& sampler);
  // Records the hits of the boresight and the corners of the image.
  void mark(const Row& row, const SurfacePoints& points);
  void prefetch(const std::uint32_t* triangles) const;
  void light_packet(const SurfacePoints& points, const std::uint16_t* own_object, std::size_t first_pixel,
                    Shading& shading, float* lit, LightSamples& samples) const;
  void shade_by_objects(const SurfacePoints& points, const std::uint16_t* own_object, std::int32_t* facing) const;
  // A packet and the solar disc; empty for a point Sun. partly: lanes for which objects hide part of the disc; free:
  // the directions that they leave free.
  struct DiscState {
    const DiscLanes* disc_lanes = nullptr;
    std::uint32_t partly = 0;
    const DiscLight::FreeDirections* free = nullptr;
  };
  std::uint32_t remove_object_shadows(const SurfacePoints& points, const std::uint16_t* own_object, std::uint32_t lanes,
                                      const DiscLanes& disc_lanes, Shading& shading, float* lit,
                                      DiscLight::FreeDirections* free) const;
  void add_samples(const SurfacePoints& points, std::uint32_t first_pixel, const DiscState& disc, bool all_inside,
                   float* lit, LightSamples& samples) const;
  // Calls visit for each pixel that loses light to terrain.
  template <typename Visit>
  void for_each_shaded(const Visit& visit) const;
  // Returns the array for the radiance of a sample: the product itself if it is the only sample.
  std::vector<float>& radiance_of(const SubpixelSample& sample) {
    return sample.store ? writer_.out().radiance : scratch_.radiance;
  }

  const FrameJob& job_;
  const FrameRequest& request_;
  const RasterMesh& mesh_;
  FrameWriter& writer_;
  FrameScratch& scratch_;
  StageTimes& times_;
  ImageTiling tiling_;
  PacketRays rays_;
  PacketShader shader_;
  std::optional<DiscLight> disc_;
  std::optional<ShadowMap> shadows_;
  std::vector<RowTerms> row_terms_;  // one, or one per row; empty: the frame needs more than row_kernel.h resolves
};

}  // namespace selenograph::engine
