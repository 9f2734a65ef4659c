// Optical flow: where the points that a frame's pixels see lie in another image of the same scene.
#pragma once

#include <cstdint>

#include "engine/camera/row_views.h"
#include "engine/support/packet.h"
#include "engine/visibility/image/frame_job.h"

namespace selenograph::engine {

class Flow {
 public:
  // `to`: views of the other image. Both arguments must outlive this object; the scene of the job must contain what
  // either image sees.
  Flow(const RowViews& to, const FrameJob& job) : to_(to), job_(job) {}

  // Pixel coordinates in the other image, inside or outside its borders; NaN if the point is hidden there or not
  // imaged.
  struct PixelPositions {
    double x[kPacket], y[kPacket];
  };
  // Sets the positions of these lanes, a bit each. A point is hidden if the ray to it from the other camera hits
  // something nearer.
  void find(const SurfacePoints& points, std::uint32_t lanes, PixelPositions& out) const;

 private:
  std::uint32_t hidden(const SurfacePoints& points, std::uint32_t requested, const Vec3 (&camera_m)[kPacket]) const;

  const RowViews& to_;
  const FrameJob& job_;
};

}  // namespace selenograph::engine
