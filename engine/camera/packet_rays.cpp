#include "engine/camera/packet_rays.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/camera/packet_rays.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Rays of a camera without distortion: linear in the pixel's coordinates.
template <PacketShape shape>
HWY_INLINE void linear_rays(const Vec3& first, const Vec3& right, const Vec3& down, const Vec3& origin, double x,
                            double y, Rays& rays) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const int column = i % pixels_across(shape), row = i / pixels_across(shape);
    const double px = x + column, py = y + row;
    rays.ox[i] = origin[0], rays.oy[i] = origin[1], rays.oz[i] = origin[2];
    rays.dx[i] = first[0] + right[0] * px + down[0] * py;
    rays.dy[i] = first[1] + right[1] * px + down[1] * py;
    rays.dz[i] = first[2] + right[2] * px + down[2] * py;
  }
}

void LinearRow(const Vec3& first, const Vec3& right, const Vec3& down, const Vec3& origin, double x, double y,
               Rays& rays) {
  linear_rays<PacketShape::row>(first, right, down, origin, x, y, rays);
}

void LinearSquare(const Vec3& first, const Vec3& right, const Vec3& down, const Vec3& origin, double x, double y,
                  Rays& rays) {
  linear_rays<PacketShape::square>(first, right, down, origin, x, y, rays);
}

// The same from places on a pinhole's plane z = 1; `m`: MOON_ME from camera, by columns.
void LensRays(const double* x, const double* y, const double* m, const double* origin, Rays& rays) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    rays.ox[i] = origin[0], rays.oy[i] = origin[1], rays.oz[i] = origin[2];
    rays.dx[i] = m[0] * x[i] + m[3] * y[i] + m[6];
    rays.dy[i] = m[1] * x[i] + m[4] * y[i] + m[7];
    rays.dz[i] = m[2] * x[i] + m[5] * y[i] + m[8];
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(LinearRow);
HWY_EXPORT(LinearSquare);
HWY_EXPORT(LensRays);

namespace {

// The same from unit directions in camera axes.
void fisheye_rays(const double* x, const double* y, const double* z, const double* m, const double* origin,
                  Rays& rays) {
  for (int i = 0; i < kPacket; ++i) {
    rays.ox[i] = origin[0], rays.oy[i] = origin[1], rays.oz[i] = origin[2];
    rays.dx[i] = m[0] * x[i] + m[3] * y[i] + m[6] * z[i];
    rays.dy[i] = m[1] * x[i] + m[4] * y[i] + m[7] * z[i];
    rays.dz[i] = m[2] * x[i] + m[5] * y[i] + m[8] * z[i];
  }
}

}  // namespace

PacketRays::PacketRays(const View& view) : view_(view), linear_(view.camera().rectilinear()) {
  const Camera& c = view.camera();
  const Eigen::Matrix3d& m = view.moon_from_camera();
  right_ = m.col(0) / c.fx, down_ = m.col(1) / c.fy, first_ = m.col(2) - right_ * c.cx - down_ * c.cy;
}

template <PacketShape shape>
void PacketRays::aim_shape(int x, int y, double dx, double dy, const PixelRays* lens, Rays& out) const {
  constexpr int kAcross = pixels_across(shape);
  const Camera& camera = view_.camera();
  if (x + kAcross <= camera.width && y + kPacket / kAcross <= camera.height)
    std::fill_n(out.valid, kPacket, true);
  else
    for (int i = 0; i < kPacket; ++i) out.valid[i] = x + i % kAcross < camera.width && y + i / kAcross < camera.height;
  if (linear_) {
    const auto& linear =
        shape == PacketShape::row ? HWY_DYNAMIC_DISPATCH(LinearRow) : HWY_DYNAMIC_DISPATCH(LinearSquare);
    linear(first_, right_, down_, view_.position(), x + dx, y + dy, out);
    return;
  }
  alignas(64) double px[kPacket], py[kPacket], pz[kPacket];
  for (int i = 0; i < kPacket; ++i) {
    px[i] = py[i] = 0, pz[i] = 1;
    if (!out.valid[i]) continue;
    const int column = x + i % kAcross, row = y + i / kAcross;
    if (lens) {
      const std::size_t at =
          static_cast<std::size_t>(row) * static_cast<std::size_t>(camera.width) + static_cast<std::size_t>(column);
      px[i] = lens->x[at], py[i] = lens->y[at];
      if (!lens->z.empty()) pz[i] = lens->z[at];
    } else if (const auto d = view_.projection().direction(column + dx, row + dy)) {
      px[i] = d->x(), py[i] = d->y(), pz[i] = d->z();
    } else {
      px[i] = std::numeric_limits<double>::quiet_NaN();
    }
    out.valid[i] = !std::isnan(px[i]);
    if (!out.valid[i]) px[i] = py[i] = 0, pz[i] = 1;
  }
  const double *m = view_.moon_from_camera().data(), *origin = view_.position().data();
  if (view_.projection().fisheye())
    fisheye_rays(px, py, pz, m, origin, out);
  else
    HWY_DYNAMIC_DISPATCH(LensRays)(px, py, m, origin, out);
}

void PacketRays::aim(PacketShape shape, int x, int y, double dx, double dy, const PixelRays* lens, Rays& out) const {
  if (shape == PacketShape::row)
    aim_shape<PacketShape::row>(x, y, dx, dy, lens, out);
  else
    aim_shape<PacketShape::square>(x, y, dx, dy, lens, out);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
