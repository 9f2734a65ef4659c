// What makes rays: the directions in which a packet of sixteen pixels looks.
#pragma once

#include "engine/camera/pixel_rays.h"
#include "engine/camera/row_views.h"
#include "engine/camera/view.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// How a packet's pixels lie together: rays that are traced are bundled best in a square, pixels that are drawn lie in a
// row.
enum class PacketShape { square, row };
inline constexpr int kPacketSide = 4;
static_assert(kPacketSide * kPacketSide == kPacket);
constexpr int pixels_across(PacketShape shape) { return shape == PacketShape::square ? kPacketSide : kPacket; }

// Of a camera without distortion: the ray of the place (x, y) in the image is first + right x + down y.
struct LinearRays {
  explicit LinearRays(const View& view);
  Vec3 first, right, down;
};

class PacketRays {
 public:
  // `view` outlives it.
  explicit PacketRays(const View& view);

  // Rays of the packet whose first pixel is (x, y), through the places (dx, dy) beside the pixels' centres. `lens`: of
  // all pixels at these places, where there is distortion and it is known; else null.
  void aim(PacketShape shape, int x, int y, double dx, double dy, const PixelRays* lens, Rays& out) const;

  // Rays of sixteen pixels wherever they are, through their centres. `lens` as above.
  void aim_at(const int* x, const int* y, const PixelRays* lens, Rays& out) const;

 private:
  template <PacketShape shape>
  void aim_shape(int x, int y, double dx, double dy, const PixelRays* lens, Rays& out) const;

  const View& view_;
  bool linear_;
  LinearRays rays_;
};

// Rays of the same square packets where each row has a view of its own; `lens`: of RowViews::camera(). With the views
// all alike they are the above's, bit for bit.
void aim_rows(const RowViews& views, int x, int y, double dx, double dy, const PixelRays* lens, Rays& out);

}  // namespace selenograph::engine
