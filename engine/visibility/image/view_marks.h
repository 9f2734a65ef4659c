// Intersections of a few lines of sight with the terrain: the boresight and the image's corners. Their pixels are drawn
// anyway, so each line is intersected with the triangles around the one that its pixel sees.
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
  // The boresight; the centres of the corner pixels: upper left, upper right, lower right, lower left.
  static constexpr std::size_t kBoresight = 0, kFirstCorner = 1, kCount = 5;

  // No marks.
  ViewMarks() = default;
  // For an image that lies `margin_px` inside the views. With a shutter the boresight is that of the middle row. A
  // boresight outside the image has no mark.
  ViewMarks(const RowViews& views, int margin_px);
  // The same places in a frame with pixels half as wide and high.
  ViewMarks dense() const;

  bool in_rows(int first, int count) const {
    bool some = false;
    for (const Mark& m : marks_) some |= m.row >= first && m.row < first + count;
    return some;
  }
  // Records the hit of a pixel that sees terrain, in a row for which in_rows() is true. Thread-safe for different
  // pixels.
  void meet(int x, int y, const SurfacePoints& points, int lane, dem::SourceIndex source) {
    for (Mark& m : marks_)
      if (m.column == x && m.row == y) {
        m.met = true;
        m.triangle = points.triangle[lane];
        m.point = points.position(lane);
        m.source = source;
      }
  }

  struct Met {
    Vec3 position_m, direction;  // direction: unit vector of the line of sight
    dem::SourceIndex source = dem::kNoSource;
  };
  // `views` and `mesh`: of the frame that was drawn. Empty: no terrain was seen there.
  std::optional<Met> met(std::size_t mark, const RowViews& views, const Mesh& mesh) const;

 private:
  struct Mark {
    double x_px = 0, y_px = 0;
    int column = -1, row = -1;
    bool met = false;
    TriangleId triangle;
    Vec3 point = Vec3::Zero();
    dem::SourceIndex source = dem::kNoSource;
  };
  void put(std::size_t mark, double x_px, double y_px);

  std::array<Mark, kCount> marks_;
};

}  // namespace selenograph::engine
