// Which of many balls' neighbourhoods a ray passes: images of balls on a plane across the rays, in cells. Most rays of
// a frame pass no rock, and here they are found without a search through the rocks.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "dem/grid/geodesy.h"
#include "engine/scene/selected_blocks.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

class BallImages {
 public:
  // For rays in one (unit) direction; `anchor_m`: of the coordinates that rays are traced in.
  static BallImages along(const Vec3& direction, const Vec3& anchor_m, std::span<const Ball> balls);
  // For rays from one place: `axes` are the image's, right, down and forward. Cells reach to slopes x/z and y/z of
  // widest_slope; beyond, all rays may meet a ball.
  static BallImages from(const Vec3& place_m, const Eigen::Matrix3d& axes, double widest_slope,
                         std::span<const Ball> balls);

  // Lanes, of those asking, whose rays may meet a ball, one bit each. Parallel rays: by their origins, MOON_ME, m. Rays
  // from one place: by their directions, which have a component forward.
  std::uint32_t may_meet(const double x[kPacket], const double y[kPacket], const double z[kPacket],
                         std::uint32_t asking) const;

 private:
  struct Box {
    double low[2], high[2];
  };
  // `room`: what cells may cover.
  void mark(std::span<const Box> boxes, const Box& room);

  // Of a ray's place or direction to its place in the image times what divides it, in cells, and to the divisor: a
  // vector and a number each.
  double maps_[3][4] = {};
  int side_ = 0, words_ = 0;         // cells along each axis, with a border of one cell; words of a row
  std::vector<std::uint32_t> bits_;  // by rows
};

}  // namespace selenograph::engine
