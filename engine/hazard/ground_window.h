// A piece of a map's heights, prepared for the planes of footprints about each of its pixels.
#pragma once

#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "engine/frame/products.h"
#include "engine/hazard/footprint.h"

namespace selenograph::engine {

struct FootprintMeasures {
  double slope_deg = std::numeric_limits<double>::quiet_NaN();  // NaN: ground without data in the footprint
  double roughness_m = 0;                                       // perpendicular to the plane
  double rock_cover = 0;
  int high_rocks = 0;  // pixels of rocks that are higher than the limit
};

class GroundWindow {
 public:
  struct Square {
    int x, y, width, height;  // pixels of the map
  };
  struct Limits {
    std::optional<double> rock_height_m;
    bool roughness;
  };
  // `products` has heights, and heights of rocks if there are any, of a map of width x height; the footprint must not
  // reach beyond it from anywhere in the square.
  GroundWindow(const FrameProducts& products, int width, int height, const Square& square,
               const FootprintOnMap& footprint, const Limits& limits);

  // About the pixels of a row of the square.
  void measure(int row, std::span<FootprintMeasures> out) const;

 private:
  // Running sums along each row: of row r the sum of pixels [first, past_last) is a difference of two of them.
  template <typename T>
  struct Sums {
    std::vector<T> all;
    std::size_t stride = 0;
    const T* row(int r) const { return all.data() + static_cast<std::size_t>(r) * stride; }
  };
  struct Plane {
    double height_m, right, down;  // at the middle; m per pixel
  };
  static constexpr int kCell = 8;

  void find_trend(const FrameProducts& products, std::size_t map_width);
  void sum_rows(const FrameProducts& products, std::size_t map_width, const Limits& limits);
  void bound_cells();
  void fit_all(int row, std::span<Plane> planes) const;
  void fit_pads(int row, std::span<Plane> planes) const;
  template <typename T>
  void count(const Sums<T>& sums, int row, std::span<int> out) const;
  double farthest(const Plane& plane, int x, int y, Eigen::Vector2i& where) const;
  double off(const Plane& plane, int x, int y, int dx, int dy) const {
    return height(x + dx, y + dy) - (plane.height_m + plane.right * dx + plane.down * dy);
  }
  double height(int x, int y) const {
    return heights_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x)];
  }

  const FootprintOnMap& footprint_;
  Square square_;
  bool roughness_;
  int left_ = 0, top_ = 0, width_ = 0, height_ = 0;  // of the window in the map
  // A plane that the window is on the whole: cells' bounds are the closer, the less steep heights are above it.
  Plane trend_{0, 0, 0};
  std::vector<double> heights_;  // above that plane; 0: no data
  Sums<double> sum_, moment_;    // of heights, and of column times height
  Sums<int> missing_, rocks_, high_;
  Eigen::Matrix3d inverse_;  // of the normal equations, over all of the footprint
  int covered_ = 0;
  struct Cell {
    double least, most;
  };
  std::vector<Cell> cells_;  // kCell x kCell pixels of the window
  int cells_across_ = 0;
};

}  // namespace selenograph::engine
