// Four samples of each pixel drawn at once: as the pixels of a frame twice as wide and as high. Strips are bounded,
// triangles set up and shadows cast once for all four; as frames of their own they took 3.4 times one frame's time.
#pragma once

#include <vector>

#include "engine/visibility/image/frame_job.h"
#include "engine/visibility/image/frame_writer.h"

namespace selenograph::engine {

// Sees what `camera` sees in pixels half as wide and high.
Camera dense_camera(const Camera& camera);

class DenseSamples {
 public:
  // Of the frame's radiance, where drawn_at_once (frame/needs.h) says 4. `job` outlives this, and so does `lens`: the
  // rays of its dense_camera.
  DenseSamples(const FrameJob& job, const PixelRays& lens, std::size_t catalogue_size);
  DenseSamples(const DenseSamples&) = delete;
  DenseSamples& operator=(const DenseSamples&) = delete;

  // What is to be drawn instead. Its samples reach the frame's `each` as the frame's own.
  const FrameJob& job() const { return job_; }
  FrameWriter& writer() { return writer_; }
  // Of the frame's pixels, once all are drawn.
  std::vector<float> radiance() const;

 private:
  void split(const SubpixelSample& sample, const std::vector<float>& radiance) const;

  const FrameJob& asked_;
  FrameRequest request_;
  RowViews views_;
  EachSample each_;
  FrameJob job_;
  FrameProducts products_;
  FrameWriter writer_;
};

}  // namespace selenograph::engine
