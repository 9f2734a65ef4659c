// A piece of a map's heights, prepared for the planes of footprints about each of its pixels.
#pragma once

#include <algorithm>
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
    // What is found is larger than this or not known; none: roughness isn't asked for. 0: all of it.
    std::optional<double> roughness_above_m;
  };
  // `products` has heights, and heights of rocks if there are any, of a map of width x height; the footprint must not
  // reach beyond it from anywhere in the square.
  GroundWindow(const FrameProducts& products, int width, int height, const Square& square,
               const FootprintOnMap& footprint, const Limits& limits);

  // Not where the pixels that the lander stands on are in line.
  bool has_planes() const { return inverse_.allFinite(); }

  // About the pixels of a row of the square.
  void measure(int row, std::span<FootprintMeasures> out) const;

 private:
  // Running sums along each row: of row r the sum of pixels [first, past_last) is a difference of two of them.
  template <typename T>
  struct Sums {
    std::vector<T> all;  // empty: 0 everywhere
    std::size_t stride = 0;
    void forget_zeros() {
      if (std::all_of(all.begin(), all.end(), [](T sum) { return sum == 0; })) all = {};
    }
    const T* row(int r) const { return all.data() + static_cast<std::size_t>(r) * stride; }
  };
  struct Plane {
    double height_m, right, down;  // at the middle; m per pixel
  };
  static constexpr int kCell = 8;
  static constexpr double kMiddle = (kCell - 1) / 2.0;  // of a cell

  void find_trend(const FrameProducts& products, std::size_t map_width);
  void sum_rows(const FrameProducts& products, std::size_t map_width, const Limits& limits);
  void bound_cells();
  void fit_all(int row, std::span<Plane> planes) const;
  void fit_pads(int row, std::span<Plane> planes) const;
  template <typename T>
  void count(const Sums<T>& sums, int row, std::span<int> out) const;
  // Neighbours along a row, whose planes are compared with a cell at once.
  static constexpr int kLanes = 8;
  using Lanes = Eigen::Array<double, kLanes, 1>;
  struct Farthest;
  void find_farthest(Farthest& lanes) const;
  void look_into(int column, std::span<const FootprintRow> rows, int lane, Farthest& lanes) const;
  void find_roughness(int row, std::span<const Plane> planes, std::span<double> farthest_m) const;
  void look_at(const Eigen::Vector2i& where, Farthest& lanes) const;
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
  }
  double height(int x, int y) const { return heights_[index(x, y)]; }

  const FootprintOnMap& footprint_;
  Square square_;
  std::optional<double> roughness_above_m_;
  int left_ = 0, top_ = 0, width_ = 0, height_ = 0;  // of the window in the map
  // A plane that the window is on the whole: cells' bounds are the closer, the less steep heights are above it.
  Plane trend_{0, 0, 0};
  std::vector<double> heights_;  // above that plane; 0: no data
  Sums<double> sum_, moment_;    // of heights, and of column times height
  Sums<int> missing_, rocks_, high_;
  Eigen::Matrix3d inverse_;  // of the normal equations, over all of the footprint
  int covered_ = 0;
  // kCell x kCell pixels of the window: within bounds about a plane of their own, which is given at their middle.
  struct Cell {
    Plane plane;
    double least, most;
  };
  std::vector<Cell> cells_;
  Cell bound_cell(int x, int y) const;
  int cells_across_ = 0;
};

}  // namespace selenograph::engine
