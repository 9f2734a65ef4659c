// What makes rays: the directions in which a packet of sixteen pixels looks.
#pragma once

#include "engine/camera/pixel_rays.h"
#include "engine/camera/view.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// How a packet's pixels lie together: rays that are traced are bundled best in a square, pixels that are drawn lie in a
// row.
enum class PacketShape { square, row };
inline constexpr int kPacketSide = 4;
static_assert(kPacketSide * kPacketSide == kPacket);
constexpr int pixels_across(PacketShape shape) { return shape == PacketShape::square ? kPacketSide : kPacket; }

class PacketRays {
 public:
  // `view` outlives it.
  explicit PacketRays(const View& view);

  // Rays of the packet whose first pixel is (x, y), through the places (dx, dy) beside the pixels' centres. `lens`: of
  // all pixels at these places, where there is distortion and it is known; else null.
  void aim(PacketShape shape, int x, int y, double dx, double dy, const PixelRays* lens, Rays& out) const;

 private:
  template <PacketShape shape>
  void aim_shape(int x, int y, double dx, double dy, const PixelRays* lens, Rays& out) const;

  const View& view_;
  bool linear_;
  Vec3 first_, right_, down_;
};

}  // namespace selenograph::engine
