#include "engine/visibility/image/edge_samples.h"

#include <algorithm>

#include "engine/frame/needs.h"
#include "engine/visibility/image/dense_samples.h"

namespace selenograph::engine {
namespace {

FrameRequest edge_request(FrameRequest request) {
  request.camera = dense_camera(request.camera);
  return request;
}

}  // namespace

bool EdgeSamples::applies_to(const FrameJob& job) {
  const Accuracy& accuracy = job.request.accuracy;
  return accuracy.edge_samples > 1 && accuracy.samples_per_pixel == 1 && wants_radiance(job.request) &&
         !job.views.vary();
}

EdgeSamples::EdgeSamples(const FrameJob& job)
    : job_(job),
      request_(edge_request(job.request)),
      views_(request_.camera, request_.pose, {}, job.stop),
      lens_(job.centres, job.request.camera, request_.camera, job.stop),
      rays_(views_.reference()),
      shader_(request_, views_, job.scene.mesh, job.radiance, job.indirect) {}

// Returns the pixels of a rectangle whose radiance differs from that of a neighbour by more than the contrast.
std::vector<std::uint32_t> EdgeSamples::find(const std::vector<float>& radiance, int x0, int y0, int width,
                                             int height) const {
  const Camera& camera = job_.request.camera;
  const auto differ = [](float a, float b) { return std::min(a, b) < kContrast * std::max(a, b); };
  std::vector<std::uint32_t> found;
  for (int y = y0; y < y0 + height; ++y) {
    const std::size_t first = static_cast<std::size_t>(y) * static_cast<std::size_t>(camera.width);
    const float* row = &radiance[first];
    const float *above = y > 0 ? row - camera.width : row, *below = y + 1 < camera.height ? row + camera.width : row;
    for (int x = x0; x < x0 + width; ++x) {
      const float centre = row[x];
      const float left = row[std::max(x - 1, 0)];
      const float right = row[std::min(x + 1, camera.width - 1)];
      if (differ(centre, left) || differ(centre, right) || differ(centre, above[x]) || differ(centre, below[x]))
        found.push_back(static_cast<std::uint32_t>(first) + static_cast<std::uint32_t>(x));
    }
  }
  return found;
}

// Aims a packet at the samples from `first` on, kPerPixel of each pixel in turn. Returns their number; lanes beyond it
// repeat the last sample and are not valid.
int EdgeSamples::aim(std::span<const std::uint32_t> pixels, std::size_t first, DensePixels& dense_pixels,
                     Rays& rays) const {
  const auto width = static_cast<std::uint32_t>(job_.request.camera.width);
  const std::size_t count = std::min<std::size_t>(kPacket, pixels.size() * kPerPixel - first);
  for (std::size_t i = 0; i < kPacket; ++i) {
    const std::size_t sample = first + std::min(i, count - 1);
    const std::uint32_t pixel = pixels[sample / kPerPixel];
    const int quarter = static_cast<int>(sample % kPerPixel);
    dense_pixels.x[i] = kSide * static_cast<int>(pixel % width) + quarter % kSide;
    dense_pixels.y[i] = kSide * static_cast<int>(pixel / width) + quarter / kSide;
  }
  rays_.aim_at(dense_pixels.x, dense_pixels.y, lens_.x.empty() ? nullptr : &lens_, rays);
  std::fill(rays.valid + count, rays.valid + kPacket, false);
  return static_cast<int>(count);
}

}  // namespace selenograph::engine
