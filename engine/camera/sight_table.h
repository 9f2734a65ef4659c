// A camera by its lines of sight, as calibrations without a model give them: a direction for each node of a lattice
// over the image. The nodes are spread evenly from the centre of the top-left pixel to that of the bottom-right one.
//
// Between the nodes the slopes x / z and y / z follow cubic convolution (Keys 1981), which is exact up to quadratic
// terms and has a continuous derivative; beyond the border pixels' centres they go on as straight lines, by up to half
// the image. Image positions are in focal lengths from a principal point, those of the pinhole that fits the slopes
// best in the sense of least squares.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dem/grid/geodesy.h"
#include "engine/frame/camera.h"

namespace selenograph::engine {

class SightTable {
 public:
  // `directions`: columns x rows, row by row, in camera axes (+x right, +y down, +z along the boresight), of any
  // length. Throws DataError naming `file` where they do not describe an image: fewer than two nodes a side, a
  // direction that is not finite or more than 84 degrees from +z, an image that is mirrored, folded or more than 10
  // times as scaled as the pinhole that fits it.
  SightTable(std::string name, std::size_t columns, std::size_t rows, const std::vector<Vec3>& directions,
             const std::string& file);

  const std::string& name() const { return name_; }
  std::uint64_t fingerprint() const { return fingerprint_; }
  std::size_t bytes() const { return slopes_.size() * sizeof slopes_[0]; }

  // The pinhole that fits best, for an image of `pixels` columns (x) or rows (y), at least 2.
  double focal_px(int axis, int pixels) const { return (pixels - 1) / span_[axis]; }
  double centre_px(int axis, int pixels) const { return -first_[axis] * focal_px(axis, pixels); }

  // Returns the position on the plane z = 1 of an image position; empty farther than half an image beyond the border.
  std::optional<Vec2> plane(const Vec2& image) const;
  // Returns the image position of a position on the plane z = 1; empty if none within reach maps there.
  std::optional<Vec2> image(const Vec2& plane) const;
  // Returns the derivative of image() there.
  Mat2 jacobian(const Vec2& plane) const;
  // Upper bound of the distance from the axis of positions that plane() returns.
  double reach() const { return reach_; }

 private:
  // Position on the plane and its derivative by the image position.
  struct Sight {
    Vec2 position;
    Mat2 derivative;
  };
  Sight sight(const Vec2& image) const;
  bool is_near(const Vec2& image) const;
  void fit(const std::string& file);
  void check_one_to_one(const std::string& file);
  Vec2 node(std::ptrdiff_t column, std::ptrdiff_t row) const;

  std::string name_;
  std::array<std::ptrdiff_t, 2> nodes_;  // columns, rows
  std::vector<Vec2> slopes_;             // x / z, y / z
  std::uint64_t fingerprint_ = 0;
  Vec2 first_, span_;  // image position of the first node, and extent of the nodes
  double reach_ = 0;
};

// Sets a camera's lines of sight and, as its fx, fy, cx and cy, the pinhole that fits them. Its sides are at least 2.
void set_sights(std::shared_ptr<const SightTable> sights, Camera& camera);

}  // namespace selenograph::engine
