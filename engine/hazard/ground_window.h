// A window of a map's heights, prepared to measure slope and roughness of the footprints centred on its pixels.
//
//   +--------------------------+   Window: the square of pixels to measure, and around it
//   |      +-----------+       |   the ground that their footprints cover.
//   |      |  square   |       |
//   |      |    .--.   |       |   x: a pixel of the square, with the footprint around it.
//   |      |   ( x  )  |       |
//   |      +----'--'---+       |
//   +--------------------------+
//
// A plane is fitted to each footprint from running sums along its rows. The roughness is the largest distance of the
// footprint's ground from that plane. To find it, cells of 8 x 8 pixels, each with a plane of its own and bounds of
// heights about it, are skipped if they cannot hold a pixel farther from the footprint's plane than the farthest so
// far.
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
    // Roughness up to this need not be measured exactly: it is reported as at most this. 0: measure all; empty:
    // roughness is not requested.
    std::optional<double> min_roughness_m;
  };
  // `products`: heights, and heights of rocks if there are any, of a map of width x height. No footprint centred in the
  // square may reach beyond the map.
  GroundWindow(const FrameProducts& products, int width, int height, const Square& square,
               const FootprintOnMap& footprint, const Limits& limits);

  // Returns false if the pixels that the lander stands on are collinear: they determine no plane.
  bool has_planes() const { return inverse_.is_finite(); }

  // Measures the footprints centred on the pixels of a row of the square.
  void measure(int row, std::span<FootprintMeasures> out) const;

 private:
  // Running sums along each row: the sum over pixels [first, past_last) of a row is a difference of two of them.
  template <typename T>
  struct Sums {
    std::vector<T> running;  // empty: 0 everywhere
    std::size_t stride = 0;  // elements per row: one more than pixels
    // Empties sums that are 0 everywhere, so that count() can skip them.
    void forget_zeros() {
      if (std::all_of(running.begin(), running.end(), [](T sum) { return sum == 0; })) running = {};
    }
    const T* row(int r) const { return running.data() + static_cast<std::size_t>(r) * stride; }
  };
  struct Plane {
    double height_m, right, down;  // height at the centre; slopes in m per pixel
  };
  static constexpr int kCell = 8;
  static constexpr double kCellCentre = (kCell - 1) / 2.0;  // offset of a cell's centre from its first pixel

  void find_trend(const FrameProducts& products, std::size_t map_width);
  void sum_rows(const FrameProducts& products, std::size_t map_width, const Limits& limits);
  void bound_cells();
  // The functions below work on a row of the square, counted from its top.
  void fit_area(int row, std::span<Plane> planes) const;
  void fit_pads(int row, std::span<Plane> planes) const;
  template <typename T>
  void count(const Sums<T>& sums, int row, std::span<int> out) const;
  // Lanes: eight neighbouring pixels of a row, whose planes are compared with a cell at once.
  static constexpr int kLanes = 8;
  struct PlaneLanes;
  void find_farthest(PlaneLanes& lanes) const;
  void search_cell(int column, std::span<const FootprintRow> rows, int lane, PlaneLanes& lanes) const;
  void find_roughness(int row, std::span<const Plane> planes, std::span<double> farthest_m) const;
  void update_neighbours(const Vec2i& pixel, PlaneLanes& lanes) const;
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
  }
  double height(int x, int y) const { return heights_[index(x, y)]; }

  const FootprintOnMap& footprint_;
  Square square_;
  std::optional<double> min_roughness_m_;
  int left_ = 0, top_ = 0, width_ = 0, height_ = 0;  // of the window in the map
  // The window's approximate plane. Heights are stored relative to it: flatter heights give the cells closer bounds.
  Plane trend_{0, 0, 0};
  std::vector<double> heights_;       // above the trend; 0: no data
  Sums<double> sum_, moment_;         // sums of heights, and of column times height
  Sums<int> missing_, rocks_, high_;  // counts of voids, of pixels of rocks, of those higher than the limit
  Mat3 inverse_;                      // of the normal equations over the pixels that the lander stands on
  int covered_ = 0;                   // pixels of the footprint
  // kCell x kCell pixels of the window: a plane, with its height at the cell's centre, and bounds of heights about it.
  struct Cell {
    Plane plane;
    double min_m, max_m;
  };
  std::vector<Cell> cells_;
  Cell bound_cell(int x, int y) const;
  int cells_per_row_ = 0;
};

}  // namespace selenograph::engine
