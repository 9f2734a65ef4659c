// Finds the rays that may hit any of many rocks: ellipsoids around the rocks are projected onto a plane across the rays
// and mark its cells. Most rays of a frame pass no rock, and here they are found without a search through the rocks.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "dem/grid/geodesy.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// The points centre + axes u with |u| <= 1.
struct Ellipsoid {
  Vec3 centre_m;
  Mat3 axes_m;
};

class EllipsoidImages {
 public:
  // Makes images for rays in a common (unit) direction. `anchor_m`: origin of the coordinates in which rays are traced.
  static EllipsoidImages along(const Vec3& direction, const Vec3& anchor_m, std::span<const Ellipsoid> ellipsoids);
  // Makes images for rays from a common origin. `axes`: right, down and forward in the image. Cells cover slopes x/z
  // and y/z up to widest_slope; outside, every ray may hit an ellipsoid.
  static EllipsoidImages from(const Vec3& origin_m, const Mat3& axes, double widest_slope,
                              std::span<const Ellipsoid> ellipsoids);

  // Returns the requested lanes whose rays may hit an ellipsoid, one bit each. Parallel rays are given by their
  // origins, MOON_ME, m; rays from a common origin by their directions, which have a component forward.
  std::uint32_t may_hit(const double x[kPacket], const double y[kPacket], const double z[kPacket],
                        std::uint32_t requested) const;

 private:
  struct Box {
    double low[2], high[2];
    float top;  // parallel rays: height along them that the ellipsoid reaches, from the anchor
  };
  struct Range {
    int first[2], last[2];
  };
  // Marks the cells of all boxes. `limits`: region that cells may cover.
  void mark(std::span<const Box> boxes, const Box& limits);
  void set(const Range& cells, float top);
  // Returns the touched lanes that start below the top of the highest ellipsoid in their square of cells.
  std::uint32_t before_tops(const double* x, const double* y, const double* z, const std::int32_t* column,
                            const std::int32_t* row, std::uint32_t touched) const;

  // Maps from the position or direction of a ray to its column and its row in cells, both times a divisor, and to that
  // divisor; each a vector and a constant.
  double maps_[3][4] = {};
  int side_ = 0, words_ = 0;         // cells along each axis, with a border of one cell; words per row of bits
  std::vector<std::uint32_t> bits_;  // one bit per cell, row by row
  // For parallel rays, the height along them that the ellipsoids in kSquare x kSquare cells reach. Points above it
  // cannot be shadowed: ground on the sunward side of a rock is such a point.
  static constexpr int kSquare = 4;
  bool parallel_ = false;
  int squares_ = 0;          // squares along each axis
  std::vector<float> tops_;  // top of each square, row by row
  double height_[4] = {};    // map from a position to its height along the rays, from the anchor
};

}  // namespace selenograph::engine
