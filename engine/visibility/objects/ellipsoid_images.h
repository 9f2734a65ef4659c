// The rocks, among many, whose neighbourhood a ray passes: images of ellipsoids around them on a plane across the rays,
// in cells. Most rays of a frame pass no rock, and here they are found without a search through the rocks.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "dem/grid/geodesy.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// {centre + axes u : |u| <= 1}.
struct Ellipsoid {
  Vec3 centre_m;
  Eigen::Matrix3d axes_m;
};

class EllipsoidImages {
 public:
  // For rays in one (unit) direction; `anchor_m`: of the coordinates that rays are traced in.
  static EllipsoidImages along(const Vec3& direction, const Vec3& anchor_m, std::span<const Ellipsoid> ellipsoids);
  // For rays from one place: `axes` are the image's, right, down and forward. Cells reach to slopes x/z and y/z of
  // widest_slope; beyond, all rays may meet an ellipsoid.
  static EllipsoidImages from(const Vec3& place_m, const Eigen::Matrix3d& axes, double widest_slope,
                              std::span<const Ellipsoid> ellipsoids);

  // Lanes, of those asking, whose rays may meet an ellipsoid, one bit each. Parallel rays: by their origins, MOON_ME,
  // m. Rays from one place: by their directions, which have a component forward.
  std::uint32_t may_meet(const double x[kPacket], const double y[kPacket], const double z[kPacket],
                         std::uint32_t asking) const;

 private:
  struct Box {
    double low[2], high[2];
    float top;  // parallel rays: how far along them the ellipsoid reaches, from the anchor
  };
  struct Range {
    int first[2], last[2];
  };
  // `room`: what cells may cover.
  void mark(std::span<const Box> boxes, const Box& room);
  void set(const Range& cells, float top);
  // Lanes, of those touched, that begin before the last ellipsoid of their cell ends.
  std::uint32_t before_tops(const double* x, const double* y, const double* z, const std::int32_t* column,
                            const std::int32_t* row, std::uint32_t touched) const;

  // Of a ray's place or direction to its place in the image times what divides it, in cells, and to the divisor: a
  // vector and a number each.
  double maps_[3][4] = {};
  int side_ = 0, words_ = 0;         // cells along each axis, with a border of one cell; words of a row
  std::vector<std::uint32_t> bits_;  // by rows
  // Parallel rays: how far along them the ellipsoids of kSquare x kSquare cells reach. Ground on the sunward side of a
  // rock begins beyond it.
  static constexpr int kSquare = 4;
  bool parallel_ = false;
  int squares_ = 0;          // along each axis
  std::vector<float> tops_;  // of squares, by rows
  double height_[4] = {};    // of a place to how far along the rays it lies, from the anchor
};

}  // namespace selenograph::engine
