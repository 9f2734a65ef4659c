// Optical flow: where what a frame's pixels see is in another image of the same scene.
#pragma once

#include <cstdint>

#include "engine/camera/row_views.h"
#include "engine/support/packet.h"
#include "engine/visibility/image/frame_job.h"

namespace selenograph::engine {

class Flow {
 public:
  // `to`: of the other image. Both must outlive this object; the job's scene must hold what either image sees.
  Flow(const RowViews& to, const FrameJob& job) : to_(to), job_(job) {}

  // Pixel coordinates in the other image, inside it or beside it; NaN where the point is hidden there or not imaged.
  struct Places {
    double x[kPacket], y[kPacket];
  };
  // Of these lanes, a bit each. A point is hidden where the ray to it from the other image's camera meets something
  // nearer.
  void find(const SurfacePoints& points, std::uint32_t lanes, Places& out) const;

 private:
  std::uint32_t hidden(const SurfacePoints& points, std::uint32_t asking, const Vec3 (&camera_m)[kPacket]) const;

  const RowViews& to_;
  const FrameJob& job_;
};

}  // namespace selenograph::engine
