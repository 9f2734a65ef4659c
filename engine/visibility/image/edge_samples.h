// More samples where a frame's are too few: where neighbours' radiance differs much, as at shadows' edges and
// silhouettes, a pixel's becomes the mean of its four quarters', which are pixels of the frame's dense camera
// (dense_samples.h). Elsewhere a sample is like those beside it.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "engine/camera/packet_rays.h"
#include "engine/camera/pixel_rays.h"
#include "engine/camera/row_views.h"
#include "engine/support/packet.h"
#include "engine/visibility/image/frame_job.h"
#include "engine/visibility/points/shading.h"

namespace selenograph::engine {

class EdgeSamples {
 public:
  static constexpr int kSide = 2;
  static constexpr std::size_t kPerPixel = kSide * kSide;

  // Whether a job wants them. Its pixels have one sample each then, in their centres.
  static bool wanted(const FrameJob& job);

  // `job` outlives it.
  explicit EdgeSamples(const FrameJob& job);
  EdgeSamples(const EdgeSamples&) = delete;
  EdgeSamples& operator=(const EdgeSamples&) = delete;

  const View& dense_view() const { return views_.reference(); }
  const PixelRays& dense_lens() const { return lens_; }
  const PacketShader& shader() const { return shader_; }

  // The frame's pixels at edges among those from (x0, y0): beside, above or below each there is one that has less than
  // kContrast of its radiance, or of which it has less.
  std::vector<std::uint32_t> find(const std::vector<float>& radiance, int x0, int y0, int width, int height) const;

  // Their samples from `first` on, sixteen or as many as there are: their rays, and which of the dense frame's pixels
  // they are. Returns how many.
  static float mean(const float* of_samples) {
    return ((of_samples[0] + of_samples[1]) + (of_samples[2] + of_samples[3])) / kPerPixel;
  }
  struct Places {
    int x[kPacket], y[kPacket];
  };
  int get(std::span<const std::uint32_t> pixels, std::size_t first, Places& places, Rays& rays) const;

 private:
  static constexpr float kContrast = 0.75F;

  const FrameJob& job_;
  FrameRequest request_;
  RowViews views_;
  PixelRays lens_;
  PacketRays rays_;
  PacketShader shader_;
};

}  // namespace selenograph::engine
