#include "engine/visibility/image/view_marks.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace selenograph::engine {
namespace {

int row_at(const RowViews& views, double y_px) {
  return std::clamp(static_cast<int>(std::lround(y_px)), 0, views.height() - 1);
}

// Returns the line of sight of a position in the image.
std::optional<Vec3> line_of_sight(const RowViews& views, double x_px, double y_px) {
  const int row = row_at(views, y_px);
  return views.of(row).ray(x_px, views.vary() ? views.line(row) : y_px);
}

// Returns the distance along the line to a triangle that faces it.
std::optional<double> distance_to(const Mesh& mesh, const TriangleId& id, const Vec3& from, const Vec3& direction) {
  constexpr double kEdge = 1e-9;  // tolerance: a line through an edge hits at least one of its triangles
  const dem::Triangle t = mesh.triangle(id);
  const Vec3 ab = t.b - t.a;
  const Vec3 ac = t.c - t.a;
  const Vec3 normal = ab.cross(ac);
  const Vec3 to_a = t.a - from;
  const double toward = normal.dot(direction);
  if (!(toward < 0)) return std::nullopt;
  const double distance = normal.dot(to_a) / toward;
  const Vec3 from_a = distance * direction - to_a;
  const double v = from_a.cross(ac).dot(normal);
  const double w = ab.cross(from_a).dot(normal);
  const double area2 = normal.squared_norm();
  if (!(distance > 0 && v >= -kEdge * area2 && w >= -kEdge * area2 && v + w <= (1 + kEdge) * area2))
    return std::nullopt;
  return distance;
}

// Returns the nearest intersection with the triangles of the block within a few quads.
std::optional<Vec3> intersection_near(const Mesh& mesh, const TriangleId& id, const Vec3& from, const Vec3& direction) {
  constexpr int kReach = 8;
  const int last = mesh.blocks()[id.block()].side - 2;
  double nearest = std::numeric_limits<double>::infinity();
  for (int r = std::max(0, id.r() - kReach); r <= std::min(last, id.r() + kReach); ++r)
    for (int c = std::max(0, id.c() - kReach); c <= std::min(last, id.c() + kReach); ++c)
      for (const bool upper : {false, true})
        nearest = std::min(nearest, distance_to(mesh, TriangleId(id.block(), r, c, upper), from, direction)
                                        .value_or(std::numeric_limits<double>::infinity()));
  if (std::isinf(nearest)) return std::nullopt;
  return from + nearest * direction;
}

}  // namespace

// Marks the boresight, if it is in the image, and the four corners, clockwise in the image from the upper left.
ViewMarks::ViewMarks(const RowViews& views, int margin_px) {
  const Camera& camera = views.camera();
  const double left = margin_px;
  const double top = margin_px;
  const double right = camera.width - 1 - margin_px;
  const double bottom = views.height() - 1 - margin_px;
  const auto boresight = views.reference().projection().image(Vec3::unit_z());
  const double x = boresight ? boresight->x : left - 1;
  const double y = !boresight || views.vary() ? (top + bottom) / 2 : boresight->y;
  if (x >= left - 0.5 && x <= right + 0.5 && y >= top - 0.5 && y <= bottom + 0.5) set_mark(kBoresight, x, y);
  set_mark(kFirstCorner, left, top);
  set_mark(kFirstCorner + 1, right, top);
  set_mark(kFirstCorner + 2, right, bottom);
  set_mark(kFirstCorner + 3, left, bottom);
}

void ViewMarks::set_mark(std::size_t mark, double x_px, double y_px) {
  Mark& m = marks_[mark];
  m.x_px = x_px;
  m.y_px = y_px;
  m.column = static_cast<int>(std::floor(x_px + 0.5));
  m.row = static_cast<int>(std::floor(y_px + 0.5));
}

ViewMarks ViewMarks::dense() const {
  ViewMarks out;
  for (std::size_t i = 0; i < kCount; ++i)
    if (marks_[i].row >= 0) out.set_mark(i, 2 * marks_[i].x_px + 0.5, 2 * marks_[i].y_px + 0.5);
  return out;
}

std::optional<ViewMarks::MarkHit> ViewMarks::hit_of(std::size_t mark, const RowViews& views, const Mesh& mesh) const {
  const Mark& m = marks_[mark];
  if (!m.hit) return std::nullopt;
  const std::optional<Vec3> line = line_of_sight(views, m.x_px, m.y_px);
  if (!line) return std::nullopt;
  const Vec3 direction = line->normalized(), from = views.of(row_at(views, m.y_px)).position();
  // Use the point of the pixel if there is no intersection, as at a silhouette.
  return MarkHit{intersection_near(mesh, m.triangle, from, direction).value_or(m.point), direction, m.source};
}

}  // namespace selenograph::engine
