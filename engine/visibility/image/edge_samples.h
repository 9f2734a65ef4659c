// Adaptive supersampling: a pixel whose radiance differs much from that of a neighbour, as at shadow edges and
// silhouettes, becomes the mean of its four quarters, which are pixels of the dense camera of the frame
// (dense_samples.h).
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

  // Returns whether a job uses edge samples. Its pixels then have one sample each, at their centres.
  static bool applies_to(const FrameJob& job);

  // `job` must outlive this object.
  explicit EdgeSamples(const FrameJob& job);
  EdgeSamples(const EdgeSamples&) = delete;
  EdgeSamples& operator=(const EdgeSamples&) = delete;

  const RowViews& dense_views() const { return views_; }
  const PixelRays& dense_lens() const { return lens_; }
  const PacketShader& shader() const { return shader_; }

  // Returns the edge pixels of the frame in a rectangle from (x0, y0): those whose radiance is less than kContrast
  // times that of a neighbour in the row or column, or the reverse.
  std::vector<std::uint32_t> find(const std::vector<float>& radiance, int x0, int y0, int width, int height) const;

  // Returns the radiance of a pixel from that of its four samples.
  static float mean(const float* of_samples) {
    return ((of_samples[0] + of_samples[1]) + (of_samples[2] + of_samples[3])) / kPerPixel;
  }
  // Pixels of the dense frame, one per lane.
  struct DensePixels {
    int x[kPacket], y[kPacket];
  };
  // Makes the rays of up to sixteen samples of edge pixels, from sample `first` on, and lists their dense pixels.
  // Returns the number of samples.
  int aim(std::span<const std::uint32_t> pixels, std::size_t first, DensePixels& dense_pixels, Rays& rays) const;

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
