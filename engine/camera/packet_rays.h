// Ray generation for packets of sixteen pixels.
#pragma once

#include "engine/camera/pixel_rays.h"
#include "engine/camera/row_views.h"
#include "engine/camera/view.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// Layout of a packet's pixels: a square for traced rays, which makes compact bundles; a row for rasterised pixels.
enum class PacketShape { square, row };
inline constexpr int kPacketSide = 4;
static_assert(kPacketSide * kPacketSide == kPacket);
constexpr int pixels_across(PacketShape shape) { return shape == PacketShape::square ? kPacketSide : kPacket; }

// Rays of a camera without distortion: the ray at the image position (x, y) is first + right x + down y.
struct LinearRays {
  explicit LinearRays(const View& view);
  Vec3 first, right, down;
};

class PacketRays {
 public:
  // `view` must outlive this object.
  explicit PacketRays(const View& view);

  // Sets the rays of the packet whose first pixel is (x, y), through positions (dx, dy) off the pixels' centres.
  // `lens`: precomputed rays of all pixels at these offsets, for a camera with distortion; null otherwise.
  void aim(PacketShape shape, int x, int y, double dx, double dy, const PixelRays* lens, Rays& out) const;

  // Sets rays through the centres of sixteen arbitrary pixels. `lens` as in aim().
  void aim_at(const int* x, const int* y, const PixelRays* lens, Rays& out) const;

 private:
  template <PacketShape shape>
  void aim_shape(int x, int y, double dx, double dy, const PixelRays* lens, Rays& out) const;

  const View& view_;
  bool linear_;
  LinearRays rays_;
};

// Sets the rays of a packet if each row has its own view. `lens`: of RowViews::camera(). With identical views the
// result equals PacketRays::aim, bit for bit.
void aim_rows(const RowViews& views, PacketShape shape, int x, int y, double dx, double dy, const PixelRays* lens,
              Rays& out);

// Rows of the frame that a packet's lanes are in.
struct PacketRows {
  int first = 0;
  PacketShape shape = PacketShape::square;
  int of(int lane) const { return first + lane / pixels_across(shape); }
};

}  // namespace selenograph::engine
