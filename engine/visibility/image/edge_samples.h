// Adaptive supersampling: where the radiance of neighbouring pixels differs much, as at shadow edges and silhouettes, a
// pixel becomes the mean of its four quarters, which are pixels of the frame's dense camera (dense_samples.h).
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

  // Whether a job uses edge samples. Its pixels then have one sample each, at their centres.
  static bool wanted(const FrameJob& job);

  // `job` must outlive this object.
  explicit EdgeSamples(const FrameJob& job);
  EdgeSamples(const EdgeSamples&) = delete;
  EdgeSamples& operator=(const EdgeSamples&) = delete;

  const View& dense_view() const { return views_.reference(); }
  const PixelRays& dense_lens() const { return lens_; }
  const PacketShader& shader() const { return shader_; }

  // Edge pixels of the frame within a rectangle from (x0, y0): pixels with a neighbour beside, above or below whose
  // radiance, or their own relative to it, is below kContrast.
  std::vector<std::uint32_t> find(const std::vector<float>& radiance, int x0, int y0, int width, int height) const;

  // Makes the rays of up to sixteen of their samples from `first` on, with the dense frame's pixels that they are.
  // Returns their number.
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
