#include "engine/camera/packet_rays.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "dem/base/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/camera/packet_rays.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Sets the rays of a camera without distortion, which are linear in the pixel's coordinates; members as in LinearRays.
// (x, y): position of the first pixel's sample.
template <PacketShape shape>
HWY_INLINE void linear_rays(const Vec3& first, const Vec3& right, const Vec3& down, const Vec3& origin, double x,
                            double y, Rays& rays) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const int column = i % pixels_across(shape), row = i / pixels_across(shape);
    const double px = x + column, py = y + row;
    rays.ox[i] = origin[0];
    rays.oy[i] = origin[1];
    rays.oz[i] = origin[2];
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

// Sets the rays through positions on a pinhole's plane z = 1. `m`: the matrix moon_from_camera by columns.
void LensRays(const double* x, const double* y, const double* m, const double* origin, Rays& rays) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    rays.ox[i] = origin[0];
    rays.oy[i] = origin[1];
    rays.oz[i] = origin[2];
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

// Sets lane i from a direction d in camera axes. `m`: the matrix moon_from_camera by columns.
void set_rotated_ray(const Vec3& d, const double* m, const double* origin, int i, Rays& rays) {
  rays.ox[i] = origin[0];
  rays.oy[i] = origin[1];
  rays.oz[i] = origin[2];
  rays.dx[i] = m[0] * d[0] + m[3] * d[1] + m[6] * d[2];
  rays.dy[i] = m[1] * d[0] + m[4] * d[1] + m[7] * d[2];
  rays.dz[i] = m[2] * d[0] + m[5] * d[1] + m[8] * d[2];
}

// Returns the direction in camera axes at (dx, dy) off a pixel's centre; empty where the lens images nothing.
std::optional<Vec3> pixel_direction(const View& view, const PixelRays* lens, int column, int row, double dx,
                                    double dy) {
  if (!lens) return view.projection().direction(column + dx, row + dy);
  const std::size_t at =
      static_cast<std::size_t>(row) * static_cast<std::size_t>(view.camera().width) + static_cast<std::size_t>(column);
  if (std::isnan(lens->x[at])) return std::nullopt;
  return Vec3(lens->x[at], lens->y[at], lens->z.empty() ? 1 : lens->z[at]);
}

}  // namespace

LinearRays::LinearRays(const View& view) {
  const Camera& c = view.camera();
  const Mat3& m = view.moon_from_camera();
  right = m.col(0) / c.fx;
  down = m.col(1) / c.fy;
  first = m.col(2) - right * c.cx - down * c.cy;
}

PacketRays::PacketRays(const View& view) : view_(view), linear_(view.camera().rectilinear()), rays_(view) {}

// Aims a packet of this shape at the samples (dx, dy) off the pixels from (x, y) on. Lanes beyond the image, and those
// where the lens images nothing, are not valid.
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
    linear(rays_.first, rays_.right, rays_.down, view_.position(), x + dx, y + dy, out);
    return;
  }
  alignas(64) double px[kPacket];
  alignas(64) double py[kPacket];
  alignas(64) double pz[kPacket];
  for (int i = 0; i < kPacket; ++i) {
    px[i] = py[i] = 0;
    pz[i] = 1;
    if (!out.valid[i]) continue;
    const auto d = pixel_direction(view_, lens, x + i % kAcross, y + i / kAcross, dx, dy);
    out.valid[i] = d.has_value();
    if (d) {
      px[i] = d->x();
      py[i] = d->y();
      pz[i] = d->z();
    }
  }
  const double *m = view_.moon_from_camera().data(), *origin = view_.position().data();
  if (view_.projection().fisheye())
    for (int i = 0; i < kPacket; ++i) set_rotated_ray({px[i], py[i], pz[i]}, m, origin, i, out);
  else
    HWY_DYNAMIC_DISPATCH(LensRays)(px, py, m, origin, out);
}

void PacketRays::aim(PacketShape shape, int x, int y, double dx, double dy, const PixelRays* lens, Rays& out) const {
  if (shape == PacketShape::row)
    aim_shape<PacketShape::row>(x, y, dx, dy, lens, out);
  else
    aim_shape<PacketShape::square>(x, y, dx, dy, lens, out);
}

void PacketRays::aim_at(const int* x, const int* y, const PixelRays* lens, Rays& out) const {
  const double *m = view_.moon_from_camera().data(), *origin = view_.position().data();
  for (int i = 0; i < kPacket; ++i) {
    if (linear_) {
      out.set(i, view_.position(), rays_.first + x[i] * rays_.right + y[i] * rays_.down);
      continue;
    }
    const auto d = pixel_direction(view_, lens, x[i], y[i], 0, 0);
    set_rotated_ray(d.value_or(Vec3::unit_z()), m, origin, i, out);
    out.valid[i] = d.has_value();
  }
}

void aim_rows(const RowViews& views, PacketShape shape, int x, int y, double dx, double dy, const PixelRays* lens,
              Rays& out) {
  const int across = pixels_across(shape);
  const int width = views.camera().width;
  const bool linear = views.camera().rectilinear();
  for (int r = 0; r < kPacket / across; ++r) {
    const bool inside = y + r < views.height();
    const int row = std::min(y + r, views.height() - 1), line = views.line(row);
    const View& view = views.of(row);
    const double *m = view.moon_from_camera().data(), *origin = view.position().data();
    std::optional<LinearRays> rays;
    if (linear) rays.emplace(view);
    for (int c = 0; c < across; ++c) {
      const int i = r * across + c;
      out.valid[i] = inside && x + c < width;
      if (rays) {
        // Add in the order of PacketRays::aim, so that the bits agree; a line camera has only its own line.
        const double px = (x + dx) + c, py = line == row ? (y + dy) + r : line + dy;
        out.ox[i] = origin[0];
        out.oy[i] = origin[1];
        out.oz[i] = origin[2];
        out.dx[i] = rays->first[0] + rays->right[0] * px + rays->down[0] * py;
        out.dy[i] = rays->first[1] + rays->right[1] * px + rays->down[1] * py;
        out.dz[i] = rays->first[2] + rays->right[2] * px + rays->down[2] * py;
        continue;
      }
      const auto d = out.valid[i] ? pixel_direction(view, lens, x + c, line, dx, dy) : std::nullopt;
      out.valid[i] = d.has_value();
      set_rotated_ray(d.value_or(Vec3::unit_z()), m, origin, i, out);
    }
  }
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
