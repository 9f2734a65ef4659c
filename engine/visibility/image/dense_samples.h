// Draws four samples of each pixel at once, as the pixels of a frame twice as wide and high. Bounds, triangle setup and
// shadow casting are then done once for all four; four separate frames took 3 to 3.7 times as long as one.
#pragma once

#include <vector>

#include "engine/visibility/image/frame_job.h"
#include "engine/visibility/image/frame_writer.h"

namespace selenograph::engine {

// Returns the camera with pixels half as wide and high.
Camera dense_camera(const Camera& camera);

class DenseSamples {
 public:
  // For frames where drawn_at_once (frame/needs.h) is 4. `job` and `lens`, the rays of its dense_camera, must outlive
  // this object.
  DenseSamples(const FrameJob& job, const PixelRays& lens, std::size_t catalogue_size);
  DenseSamples(const DenseSamples&) = delete;
  DenseSamples& operator=(const DenseSamples&) = delete;

  // The job to draw instead. Its samples reach the `each` of the frame as samples of the frame.
  const FrameJob& job() const { return job_; }
  FrameWriter& writer() { return writer_; }
  // Returns the radiance of the pixels of the frame; call it after all samples are drawn.
  std::vector<float> radiance() const;

 private:
  void split(const SubpixelSample& sample, const std::vector<float>& radiance) const;

  const FrameJob& frame_job_;
  FrameRequest request_;
  RowViews views_;
  EachSample each_;
  FrameJob job_;
  FrameProducts products_;
  FrameWriter writer_;
};

}  // namespace selenograph::engine
