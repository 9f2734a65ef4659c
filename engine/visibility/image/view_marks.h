// Intersections of a few lines of sight with the terrain: of the boresight and the corners of the image. Their pixels
// are drawn anyway, so each line is intersected with the triangles around the one that its pixel sees.
#pragma once

#include <array>
#include <cstddef>
#include <optional>

#include "dem/grid/block.h"
#include "engine/camera/row_views.h"
#include "engine/scene/mesh.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

class ViewMarks {
 public:
  // Indices of the marks: the boresight, then the centres of the corner pixels: upper left, upper right, lower right,
  // lower left.
  static constexpr std::size_t kBoresight = 0, kFirstCorner = 1, kCount = 5;

  // Makes no marks.
  ViewMarks() = default;
  // Makes the marks of an image that lies `margin_px` inside the views. With a shutter, the boresight is that of the
  // middle row. A boresight outside the image has no mark.
  ViewMarks(const RowViews& views, int margin_px);
  // Returns the marks of the same points in a frame with pixels half as wide and high.
  ViewMarks dense() const;

  bool in_rows(int first, int count) const {
    bool found = false;
    for (const Mark& m : marks_) found |= m.row >= first && m.row < first + count;
    return found;
  }
  // Records the hit of a pixel that sees terrain, in a row for which in_rows() is true. Thread-safe for different
  // pixels.
  void record(int x, int y, const SurfacePoints& points, int lane, dem::SourceIndex source) {
    for (Mark& m : marks_)
      if (m.column == x && m.row == y) {
        m.hit = true;
        m.triangle = points.triangle[lane];
        m.point = points.position(lane);
        m.source = source;
      }
  }

  // Point of the terrain on the line of sight of a mark.
  struct MarkHit {
    Vec3 position_m, direction;  // direction: unit vector of the line of sight
    dem::SourceIndex source = dem::kNoSource;
  };
  // Returns the point of a mark; empty if no terrain is visible there. `views` and `mesh`: those of the frame that was
  // drawn.
  std::optional<MarkHit> hit_of(std::size_t mark, const RowViews& views, const Mesh& mesh) const;

 private:
  struct Mark {
    double x_px = 0, y_px = 0;
    int column = -1, row = -1;
    bool hit = false;
    TriangleId triangle;
    Vec3 point = Vec3::zero();
    dem::SourceIndex source = dem::kNoSource;
  };
  void set_mark(std::size_t mark, double x_px, double y_px);

  std::array<Mark, kCount> marks_;
};

}  // namespace selenograph::engine
