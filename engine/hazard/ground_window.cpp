#include "engine/hazard/ground_window.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace selenograph::engine {
namespace {

// Returns the inverse of a plane's normal equations for the unknowns height, slope to the right, slope down. Calls
// visit_offsets(add), which calls add(right, down) for each pixel that the lander stands on.
template <typename VisitOffsets>
Mat3 inverse_of_normal_equations(const VisitOffsets& visit_offsets) {
  Mat3 sum = Mat3::zero();
  visit_offsets([&](int right, int down) {
    const Vec3 row(1, right, down);
    sum += Mat3(row, row * right, row * down);
  });
  return sum.inverse();
}

}  // namespace

GroundWindow::GroundWindow(const FrameProducts& products, int width, int height, const Square& square,
                           const FootprintOnMap& footprint, const Limits& limits)
    : footprint_(footprint), square_(square), min_roughness_m_(limits.min_roughness_m) {
  int left = 0, right = 0;
  for (const FootprintRow& r : footprint.rows) {
    left = std::max(left, -r.first);
    right = std::max(right, r.past_last - 1);
    covered_ += r.past_last - r.first;
  }
  int up = std::max(0, -footprint.rows.front().row), down = std::max(0, footprint.rows.back().row);
  for (const Vec2i& pad : footprint.pads) {
    left = std::max(left, -pad.x());
    right = std::max(right, pad.x());
    up = std::max(up, -pad.y());
    down = std::max(down, pad.y());
  }
  left_ = square.x - left;
  top_ = square.y - up;
  width_ = square.width + left + right;
  height_ = square.height + up + down;
  if (left_ < 0 || top_ < 0 || left_ + width_ > width || top_ + height_ > height)
    throw std::logic_error("a footprint reaches beyond what was drawn");
  find_trend(products, static_cast<std::size_t>(width));
  sum_rows(products, static_cast<std::size_t>(width), limits);
  if (min_roughness_m_) bound_cells();
  inverse_ = inverse_of_normal_equations([&](const auto& add) {
    if (footprint.pads.empty()) {
      for (const FootprintRow& r : footprint.rows)
        for (int x = r.first; x < r.past_last; ++x) add(x, r.row);
    }
    for (const Vec2i& pad : footprint.pads) add(pad.x(), pad.y());
  });
}

// Computes the trend from the corners of the square, if they have data.
void GroundWindow::find_trend(const FrameProducts& products, std::size_t map_width) {
  const auto map_height_m = [&](int x, int y) {
    return products.height[static_cast<std::size_t>(y) * map_width + static_cast<std::size_t>(x)];
  };
  const int left = square_.x, right = square_.x + square_.width - 1;
  const int top = square_.y, bottom = square_.y + square_.height - 1;
  const double top_left_m = map_height_m(left, top), top_right_m = map_height_m(right, top);
  const double bottom_left_m = map_height_m(left, bottom), bottom_right_m = map_height_m(right, bottom);
  if (!std::isfinite(top_left_m + top_right_m + bottom_left_m + bottom_right_m)) return;
  trend_.right = (top_right_m - top_left_m + bottom_right_m - bottom_left_m) / (2.0 * std::max(1, square_.width - 1));
  trend_.down = (bottom_left_m - top_left_m + bottom_right_m - top_right_m) / (2.0 * std::max(1, square_.height - 1));
  // The trend's height is that at the window's first pixel.
  trend_.height_m = top_left_m - trend_.right * (left - left_) - trend_.down * (top - top_);
}

// Stores the heights above the trend and their running sums, and counts of voids and rocks.
void GroundWindow::sum_rows(const FrameProducts& products, std::size_t map_width, const Limits& limits) {
  const auto stride = static_cast<std::size_t>(width_) + 1, rows = static_cast<std::size_t>(height_);
  const auto map_index = [&](int x, int y) {
    return static_cast<std::size_t>(top_ + y) * map_width + static_cast<std::size_t>(left_ + x);
  };
  heights_.resize(rows * static_cast<std::size_t>(width_) + kLanes);  // padding: lanes read past the last row
  const auto allocate = [&](auto& sums) {
    sums.running.resize(rows * stride);
    sums.stride = stride;
  };
  allocate(sum_);
  allocate(moment_);
  allocate(missing_);
  const bool rocks = !products.rock_height.empty();
  if (rocks) {
    allocate(rocks_);
    allocate(high_);
  }
  for (int y = 0; y < height_; ++y) {
    const std::size_t row = static_cast<std::size_t>(y) * stride;
    for (int x = 0; x < width_; ++x) {
      const double map_height_m = products.height[map_index(x, y)];
      const bool is_void = std::isnan(map_height_m);
      const double height_m = is_void ? 0 : map_height_m - trend_.height_m - trend_.right * x - trend_.down * y;
      heights_[index(x, y)] = height_m;
      const std::size_t next = row + static_cast<std::size_t>(x) + 1;
      sum_.running[next] = sum_.running[next - 1] + height_m;
      moment_.running[next] = moment_.running[next - 1] + x * height_m;
      missing_.running[next] = missing_.running[next - 1] + is_void;
      if (!rocks) continue;
      const float rock_m = products.rock_height[map_index(x, y)];
      rocks_.running[next] = rocks_.running[next - 1] + (rock_m > 0);
      high_.running[next] =
          high_.running[next - 1] + (limits.rock_height_m && static_cast<double>(rock_m) > *limits.rock_height_m);
    }
  }
  missing_.forget_zeros();
  rocks_.forget_zeros();
  high_.forget_zeros();
}

// Divides the window into cells, row by row, and bounds each.
void GroundWindow::bound_cells() {
  cells_per_row_ = (width_ + kCell - 1) / kCell;
  for (int y = 0; y < height_; y += kCell)
    for (int x = 0; x < width_; x += kCell) cells_.push_back(bound_cell(x, y));
}

// Returns a cell with its bounds. Its plane has the slopes between the means of opposite sides; any plane would do, and
// a close one gives close bounds.
GroundWindow::Cell GroundWindow::bound_cell(int x0, int y0) const {
  const int right = std::min(x0 + kCell, width_) - 1, bottom = std::min(y0 + kCell, height_) - 1;
  const int columns = right - x0 + 1, rows = bottom - y0 + 1;
  Cell cell{{0, 0, 0}, std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  for (int y = y0; y <= bottom; ++y) cell.plane.right += height(right, y) - height(x0, y);
  for (int x = x0; x <= right; ++x) cell.plane.down += height(x, bottom) - height(x, y0);
  cell.plane.right /= rows * std::max(1, columns - 1);
  cell.plane.down /= columns * std::max(1, rows - 1);
  for (int y = y0; y <= bottom; ++y)
    for (int x = x0; x <= right; ++x) {
      const double above_plane_m =
          height(x, y) - cell.plane.right * (x - x0 - kCellCentre) - cell.plane.down * (y - y0 - kCellCentre);
      cell.min_m = std::min(cell.min_m, above_plane_m);
      cell.max_m = std::max(cell.max_m, above_plane_m);
    }
  return cell;
}

// Fits a plane to the whole footprint of each pixel of a row: least squares from sums over the footprint's rows. The
// right side of the normal equations are sums of height, of height times offset to the right, and times offset down.
void GroundWindow::fit_area(int row, std::span<Plane> planes) const {
  const auto width = static_cast<std::size_t>(square_.width);
  std::vector<double> sums(3 * width, 0.0);
  double *sum = sums.data(), *right = sum + width, *down = right + width;
  const int square_left = square_.x - left_;  // column of the window
  for (const FootprintRow& r : footprint_.rows) {
    const int y = square_.y - top_ + row + r.row;
    const double *first = sum_.row(y) + square_left + r.first, *past_last = sum_.row(y) + square_left + r.past_last;
    const double *first_moment = moment_.row(y) + square_left + r.first,
                 *past_last_moment = moment_.row(y) + square_left + r.past_last;
    const double row_offset = r.row;
    for (std::size_t i = 0; i < width; ++i) {
      const double height_sum = past_last[i] - first[i];
      sum[i] += height_sum;
      down[i] += row_offset * height_sum;
      // Moments count columns from the window's left; subtracting the pixel's own column makes them offsets.
      const double column = square_left + static_cast<int>(i);
      right[i] += past_last_moment[i] - first_moment[i] - column * height_sum;
    }
  }
  for (std::size_t i = 0; i < width; ++i) {
    const Vec3 plane = inverse_ * Vec3(sum[i], right[i], down[i]);
    planes[i] = {plane[0], plane[1], plane[2]};
  }
}

// Fits a plane to the pads of each pixel of a row; NaN if a pad has no data.
void GroundWindow::fit_pads(int row, std::span<Plane> planes) const {
  const int y = square_.y - top_ + row;
  for (int i = 0; i < square_.width; ++i) {
    const int x = square_.x - left_ + i;
    Vec3 sum = Vec3::zero();
    for (const Vec2i& pad : footprint_.pads) sum += height(x + pad.x(), y + pad.y()) * Vec3(1, pad.x(), pad.y());
    for (const Vec2i& pad : footprint_.pads) {
      if (missing_.running.empty()) break;
      // The running count grows across the pad's pixel if it is a void.
      const int* missing = missing_.row(y + pad.y()) + x + pad.x();
      if (missing[1] > missing[0]) sum = Vec3::constant(std::numeric_limits<double>::quiet_NaN());
    }
    const Vec3 plane = inverse_ * sum;
    planes[static_cast<std::size_t>(i)] = {plane[0], plane[1], plane[2]};
  }
}

// Sums counts over the footprint of each pixel of a row.
template <typename T>
void GroundWindow::count(const Sums<T>& sums, int row, std::span<int> out) const {
  std::fill(out.begin(), out.end(), 0);
  if (sums.running.empty()) return;
  for (const FootprintRow& r : footprint_.rows) {
    const T* row_sums = sums.row(square_.y - top_ + row + r.row) + (square_.x - left_);
    for (std::size_t i = 0; i < out.size(); ++i)
      out[i] += row_sums[static_cast<int>(i) + r.past_last] - row_sums[static_cast<int>(i) + r.first];
  }
}

// The planes of eight neighbouring pixels, and the largest vertical distance found from each.
struct GroundWindow::PlaneLanes {
  using Lanes = Eigen::Array<double, kLanes, 1>;
  int x, y;  // first pixel, in the window
  Lanes centre_m, right, down;
  Lanes farthest_m;  // infinite: lane without a plane
  Vec2i pixel;       // in the window: the pixel that last enlarged farthest_m
};

// Finds the farthest ground from each lane's plane. Searches only cells whose bounds allow ground farther than found so
// far.
void GroundWindow::find_farthest(PlaneLanes& lanes) const {
  using Lanes = PlaneLanes::Lanes;
  constexpr double kRounding_m = 1e-9;
  // Heights of the planes at the window's left, in the row of the lanes.
  const Lanes left_planes_m = lanes.centre_m - lanes.right * (lanes.x + Lanes::LinSpaced(0, kLanes - 1));
  const std::span<const FootprintRow> rows(footprint_.rows);
  for (std::size_t first = 0; first < rows.size();) {
    // Collect the footprint's rows in one row of cells.
    const int cell_row = (lanes.y + rows[first].row) / kCell;
    std::size_t past_last = first;
    int from = rows[first].first, to = rows[first].past_last;
    for (; past_last < rows.size() && (lanes.y + rows[past_last].row) / kCell == cell_row; ++past_last) {
      from = std::min(from, rows[past_last].first);
      to = std::max(to, rows[past_last].past_last);
    }
    // Heights of the planes at the window's left, in the middle of the cells' rows.
    const Lanes row_planes_m = left_planes_m + lanes.down * (cell_row * kCell + kCellCentre - lanes.y);
    const int last = std::min((lanes.x + kLanes - 1 + to - 1) / kCell, cells_per_row_ - 1);
    for (int column = (lanes.x + from) / kCell; column <= last; ++column) {
      const Cell& cell = cells_[static_cast<std::size_t>(cell_row * cells_per_row_ + column)];
      // Bound: the farther end of the cell's heights from the plane at the cell's centre, and the tilt between the
      // cell's plane and the lane's over half a cell.
      const Lanes plane_m = row_planes_m + lanes.right * (column * kCell + kCellCentre);
      const Lanes tilt_m =
          ((cell.plane.right - lanes.right).abs() + (cell.plane.down - lanes.down).abs()) * kCellCentre + kRounding_m;
      const Lanes bound_m = (cell.max_m - plane_m).max(plane_m - cell.min_m) + tilt_m;
      if (!((bound_m - lanes.farthest_m).maxCoeff() > 0)) continue;
      for (int i = 0; i < kLanes; ++i)
        if (bound_m[i] > lanes.farthest_m[i]) search_cell(column, rows.subspan(first, past_last - first), i, lanes);
    }
    first = past_last;
  }
}

// Searches the covered pixels of a cell, eight of a row at once. Where the footprint covers only some of the cell's
// pixels in a row, the eight shift to include other covered pixels: they belong to the footprint, too.
void GroundWindow::search_cell(int column, std::span<const FootprintRow> rows, int lane, PlaneLanes& lanes) const {
  using Lanes = PlaneLanes::Lanes;
  const int x = lanes.x + lane, left = column * kCell - x;  // left: the cell's offset from the lane's pixel
  const Lanes steps_m = lanes.right[lane] * Lanes::LinSpaced(0, kLanes - 1);  // of the plane, from pixel to pixel
  double farthest_m = lanes.farthest_m[lane];
  for (const FootprintRow& r : rows) {
    if (r.past_last <= left || r.first >= left + kCell) continue;
    const int first = std::max(r.first, std::min(left, r.past_last - kLanes)), count_px = r.past_last - first;
    const double plane_m = lanes.centre_m[lane] + lanes.down[lane] * r.row + lanes.right[lane] * first;
    Lanes off_m = (Eigen::Map<const Lanes>(&heights_[index(x + first, lanes.y + r.row)]) - plane_m - steps_m).abs();
    if (count_px < kLanes) off_m = (Lanes::LinSpaced(0, kLanes - 1) < count_px).select(off_m, 0);
    if (!(off_m.maxCoeff() > farthest_m)) continue;
    int pixel = 0;
    farthest_m = off_m.maxCoeff(&pixel);
    lanes.pixel = {x + first + pixel, lanes.y + r.row};
  }
  if (farthest_m > lanes.farthest_m[lane]) update_neighbours(lanes.pixel, lanes);
}

// Updates all lanes with one pixel: ground far from one plane is far from its neighbours' planes, and large distances
// found early let more cells be skipped.
void GroundWindow::update_neighbours(const Vec2i& pixel, PlaneLanes& lanes) const {
  const int row = pixel.y() - lanes.y - footprint_.rows.front().row;
  if (row < 0 || row >= static_cast<int>(footprint_.rows.size())) return;
  const FootprintRow& r = footprint_.rows[static_cast<std::size_t>(row)];
  const double height_m = height(pixel.x(), pixel.y());
  for (int i = 0; i < kLanes; ++i) {
    const int dx = pixel.x() - lanes.x - i;
    if (dx < r.first || dx >= r.past_last) continue;
    const double plane_m = lanes.centre_m[i] + lanes.down[i] * r.row + lanes.right[i] * dx;
    lanes.farthest_m[i] = std::max(lanes.farthest_m[i], std::abs(height_m - plane_m));
  }
}

// Enlarges `farthest_m` to the largest vertical distances of ground from the planes of a row. NaN planes are skipped.
void GroundWindow::find_roughness(int row, std::span<const Plane> planes, std::span<double> farthest_m) const {
  const int count_px = static_cast<int>(farthest_m.size());
  PlaneLanes lanes{square_.x - left_, square_.y - top_ + row, {}, {}, {}, {}, {0, 0}};
  for (int first = 0; first < count_px; first += kLanes, lanes.x += kLanes) {
    lanes.centre_m = lanes.right = lanes.down = 0;
    lanes.farthest_m = std::numeric_limits<double>::infinity();
    for (int i = 0; i < std::min(kLanes, count_px - first); ++i) {
      const Plane& plane = planes[static_cast<std::size_t>(first + i)];
      if (std::isnan(plane.height_m)) continue;
      lanes.centre_m[i] = plane.height_m;
      lanes.right[i] = plane.right;
      lanes.down[i] = plane.down;
      lanes.farthest_m[i] = farthest_m[static_cast<std::size_t>(first + i)];
    }
    // Begin with the pixel that was farthest from the planes of the eight pixels before.
    update_neighbours(lanes.pixel, lanes);
    find_farthest(lanes);
    for (int i = 0; i < std::min(kLanes, count_px - first); ++i)
      if (!std::isinf(lanes.farthest_m[i])) farthest_m[static_cast<std::size_t>(first + i)] = lanes.farthest_m[i];
  }
}

// The planes are in metres per pixel. In metres per metre their gradient is the tangent of the slope, and vertical
// distances divided by sqrt(1 + gradient^2) are perpendicular to the plane.
void GroundWindow::measure(int row, std::span<FootprintMeasures> out) const {
  std::vector<Plane> planes(out.size());
  std::vector<int> missing(out.size()), rocks(out.size()), high(out.size());
  if (footprint_.pads.empty())
    fit_area(row, planes);
  else
    fit_pads(row, planes);
  count(missing_, row, missing);
  count(rocks_, row, rocks);
  count(high_, row, high);
  // Slopes per pixel are metres_per_px^T times the gradient (east, north).
  const Mat2 to_gradient = footprint_.metres_per_px.transpose().inverse();
  std::vector<double> gradient(out.size()), farthest_m(out.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    gradient[i] = (to_gradient * Vec2(planes[i].right + trend_.right, planes[i].down + trend_.down)).norm();
    // Start a little below the limit: by rounding, a distance at the limit must not exceed it.
    farthest_m[i] = min_roughness_m_.value_or(0) * (1 - 1e-12) * std::sqrt(1 + gradient[i] * gradient[i]);
  }
  if (min_roughness_m_) find_roughness(row, planes, farthest_m);
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = {};
    if (missing[i] > 0) continue;
    out[i].slope_deg = std::atan(gradient[i]) * kDegreesPerRadian;
    out[i].roughness_m = farthest_m[i] / std::sqrt(1 + gradient[i] * gradient[i]);
    out[i].rock_cover = static_cast<double>(rocks[i]) / covered_;
    out[i].high_rocks = high[i];
  }
}

}  // namespace selenograph::engine
