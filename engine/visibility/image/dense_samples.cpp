#include "engine/visibility/image/dense_samples.h"

#include "dem/base/parallel.h"

namespace selenograph::engine {
namespace {

constexpr int kSide = 2;  // dense pixels along the side of a pixel

FrameRequest dense_request(FrameRequest request) {
  request.camera = dense_camera(request.camera);
  request.accuracy.samples_per_pixel /= kSide * kSide;
  request.products = kRadiance;
  return request;
}

// Calls visit(pixel, its first dense pixel) for all pixels of a frame.
template <typename Visit>
void for_pixels(const FrameJob& frame, const Visit& visit) {
  const auto width = static_cast<std::size_t>(frame.request.camera.width);
  const auto height = static_cast<std::size_t>(frame.request.camera.height);
  in_parallel_pieces(height, 32, [&](std::size_t first, std::size_t past_last) {
    frame.stop.check();
    for (std::size_t y = first; y < past_last; ++y)
      for (std::size_t x = 0; x < width; ++x) visit(y * width + x, kSide * (y * kSide * width + x));
  });
}

}  // namespace

// The centre of the first quarter of the first pixel is the centre of the dense pixel (0, 0).
Camera dense_camera(const Camera& camera) {
  Camera dense = camera;
  dense.width *= kSide;
  dense.height *= kSide;
  dense.fx *= kSide;
  dense.fy *= kSide;
  dense.cx = kSide * camera.cx + (kSide - 1) / 2.0;
  dense.cy = kSide * camera.cy + (kSide - 1) / 2.0;
  return dense;
}

DenseSamples::DenseSamples(const FrameJob& job, const PixelRays& lens, std::size_t catalogue_size)
    : frame_job_(job),
      request_(dense_request(job.request)),
      views_(request_.camera, request_.pose, {}, job.stop),
      job_{request_, views_, job.scene, job.objects, job.radiance, lens, job.stop, each_, job.indirect},
      writer_(request_, views_, job.scene.mesh, catalogue_size, products_, job.stop) {
  if (job.each)
    each_ = [this](const SubpixelSample& sample, const std::vector<float>& radiance) { split(sample, radiance); };
}

// Hands one sample of the dense frame over as kSide x kSide samples of the frame, a quarter of a pixel off its centres.
void DenseSamples::split(const SubpixelSample& sample, const std::vector<float>& radiance) const {
  const auto row = static_cast<std::size_t>(request_.camera.width);
  std::vector<float> sample_radiance(radiance.size() / (kSide * kSide));
  for (int j = 0; j < kSide; ++j)
    for (int i = 0; i < kSide; ++i) {
      const std::size_t offset = static_cast<std::size_t>(j) * row + static_cast<std::size_t>(i);
      for_pixels(frame_job_,
                 [&](std::size_t at, std::size_t dense) { sample_radiance[at] = radiance[dense + offset]; });
      SubpixelSample frame_sample = sample;
      frame_sample.dx = ((i + 0.5) + sample.dx) / kSide - 0.5;
      frame_sample.dy = ((j + 0.5) + sample.dy) / kSide - 0.5;
      frame_sample.weight = sample.weight / (kSide * kSide);
      frame_job_.each(frame_sample, sample_radiance);
    }
}

std::vector<float> DenseSamples::radiance() const {
  const auto row = static_cast<std::size_t>(request_.camera.width);
  const std::vector<float>& dense = products_.radiance;
  std::vector<float> means(dense.size() / (kSide * kSide));
  for_pixels(frame_job_, [&](std::size_t at, std::size_t first) {
    means[at] = ((dense[first] + dense[first + 1]) + (dense[first + row] + dense[first + row + 1])) / (kSide * kSide);
  });
  return means;
}

}  // namespace selenograph::engine
