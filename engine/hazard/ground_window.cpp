#include "engine/hazard/ground_window.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace selenograph::engine {
namespace {

// Normal equations of a plane, 1, right, down.
template <typename Offsets>
Eigen::Matrix3d inverse_of_normal_equations(const Offsets& offsets) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  offsets([&](int right, int down) {
    const Eigen::Vector3d row(1, right, down);
    sum += row * row.transpose();
  });
  return sum.inverse();
}

}  // namespace

GroundWindow::GroundWindow(const FrameProducts& products, int width, int height, const Square& square,
                           const FootprintOnMap& footprint, const Limits& limits)
    : footprint_(footprint), square_(square), roughness_above_m_(limits.roughness_above_m) {
  int left = 0, right = 0;
  for (const FootprintRow& r : footprint.rows) {
    left = std::max(left, -r.first);
    right = std::max(right, r.past_last - 1);
    covered_ += r.past_last - r.first;
  }
  int up = std::max(0, -footprint.rows.front().row), down = std::max(0, footprint.rows.back().row);
  for (const Eigen::Vector2i& pad : footprint.pads) {
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
  if (roughness_above_m_) bound_cells();
  inverse_ = inverse_of_normal_equations([&](const auto& add) {
    if (footprint.pads.empty()) {
      for (const FootprintRow& r : footprint.rows)
        for (int x = r.first; x < r.past_last; ++x) add(x, r.row);
    }
    for (const Eigen::Vector2i& pad : footprint.pads) add(pad.x(), pad.y());
  });
}

// From the corners of the square, if they have data.
void GroundWindow::find_trend(const FrameProducts& products, std::size_t map_width) {
  const auto at = [&](int x, int y) {
    return products.height[static_cast<std::size_t>(y) * map_width + static_cast<std::size_t>(x)];
  };
  const int right = square_.x + square_.width - 1, bottom = square_.y + square_.height - 1;
  const double a = at(square_.x, square_.y), b = at(right, square_.y), c = at(square_.x, bottom), d = at(right, bottom);
  if (!std::isfinite(a + b + c + d)) return;
  trend_.right = (b - a + d - c) / (2.0 * std::max(1, square_.width - 1));
  trend_.down = (c - a + d - b) / (2.0 * std::max(1, square_.height - 1));
  trend_.height_m = a - trend_.right * (square_.x - left_) - trend_.down * (square_.y - top_);
}

void GroundWindow::sum_rows(const FrameProducts& products, std::size_t map_width, const Limits& limits) {
  const auto stride = static_cast<std::size_t>(width_) + 1, rows = static_cast<std::size_t>(height_);
  const auto at = [&](int x, int y) {
    return static_cast<std::size_t>(top_ + y) * map_width + static_cast<std::size_t>(left_ + x);
  };
  heights_.resize(rows * static_cast<std::size_t>(width_) + kLanes);  // some are looked at beyond the last row
  const auto make = [&](auto& sums) { sums.all.resize(rows * stride), sums.stride = stride; };
  make(sum_);
  make(moment_);
  make(missing_);
  const bool rocks = !products.rock_height.empty();
  if (rocks) {
    make(rocks_);
    make(high_);
  }
  for (int y = 0; y < height_; ++y) {
    const std::size_t row = static_cast<std::size_t>(y) * stride;
    for (int x = 0; x < width_; ++x) {
      const double given_m = products.height[at(x, y)];
      const bool none = std::isnan(given_m);
      const double height_m = none ? 0 : given_m - trend_.height_m - trend_.right * x - trend_.down * y;
      heights_[index(x, y)] = height_m;
      const std::size_t next = row + static_cast<std::size_t>(x) + 1;
      sum_.all[next] = sum_.all[next - 1] + height_m;
      moment_.all[next] = moment_.all[next - 1] + x * height_m;
      missing_.all[next] = missing_.all[next - 1] + none;
      if (!rocks) continue;
      const float rock_m = products.rock_height[at(x, y)];
      rocks_.all[next] = rocks_.all[next - 1] + (rock_m > 0);
      high_.all[next] =
          high_.all[next - 1] + (limits.rock_height_m && static_cast<double>(rock_m) > *limits.rock_height_m);
    }
  }
  missing_.forget_zeros();
  rocks_.forget_zeros();
  high_.forget_zeros();
}

void GroundWindow::bound_cells() {
  cells_across_ = (width_ + kCell - 1) / kCell;
  for (int y = 0; y < height_; y += kCell)
    for (int x = 0; x < width_; x += kCell) cells_.push_back(bound_cell(x, y));
}

// Its plane goes by the means of its sides: any would do, this is close.
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
      const double left_m = height(x, y) - cell.plane.right * (x - x0 - kMiddle) - cell.plane.down * (y - y0 - kMiddle);
      cell.least = std::min(cell.least, left_m);
      cell.most = std::max(cell.most, left_m);
    }
  return cell;
}

// By least squares, from the sums over the footprint's rows.
void GroundWindow::fit_all(int row, std::span<Plane> planes) const {
  const auto width = static_cast<std::size_t>(square_.width);
  std::vector<double> sums(3 * width, 0.0);
  double *sum = sums.data(), *right = sum + width, *down = right + width;
  const int from = square_.x - left_;
  for (const FootprintRow& r : footprint_.rows) {
    const int y = square_.y - top_ + row + r.row;
    const double *first = sum_.row(y) + from + r.first, *last = sum_.row(y) + from + r.past_last,
                 *first_moment = moment_.row(y) + from + r.first, *last_moment = moment_.row(y) + from + r.past_last;
    const double below = r.row;
    for (std::size_t i = 0; i < width; ++i) {
      const double heights = last[i] - first[i];
      sum[i] += heights;
      down[i] += below * heights;
      right[i] += last_moment[i] - first_moment[i] - static_cast<double>(from + static_cast<int>(i)) * heights;
    }
  }
  for (std::size_t i = 0; i < width; ++i) {
    const Eigen::Vector3d plane = inverse_ * Eigen::Vector3d(sum[i], right[i], down[i]);
    planes[i] = {plane[0], plane[1], plane[2]};
  }
}

void GroundWindow::fit_pads(int row, std::span<Plane> planes) const {
  const int y = square_.y - top_ + row;
  for (int i = 0; i < square_.width; ++i) {
    const int x = square_.x - left_ + i;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const Eigen::Vector2i& pad : footprint_.pads)
      sum += height(x + pad.x(), y + pad.y()) * Eigen::Vector3d(1, pad.x(), pad.y());
    for (const Eigen::Vector2i& pad : footprint_.pads) {
      if (missing_.all.empty()) break;
      const int* missing = missing_.row(y + pad.y()) + x + pad.x();
      if (missing[1] > missing[0]) sum.setConstant(std::numeric_limits<double>::quiet_NaN());
    }
    const Eigen::Vector3d plane = inverse_ * sum;
    planes[static_cast<std::size_t>(i)] = {plane[0], plane[1], plane[2]};
  }
}

template <typename T>
void GroundWindow::count(const Sums<T>& sums, int row, std::span<int> out) const {
  std::fill(out.begin(), out.end(), 0);
  if (sums.all.empty()) return;
  for (const FootprintRow& r : footprint_.rows) {
    const T* of_row = sums.row(square_.y - top_ + row + r.row) + (square_.x - left_);
    for (std::size_t i = 0; i < out.size(); ++i)
      out[i] += of_row[static_cast<int>(i) + r.past_last] - of_row[static_cast<int>(i) + r.first];
  }
}

// The largest distances from planes, vertically, for pixels that are side by side.
struct GroundWindow::Farthest {
  int x, y;  // of the first, in the window
  Lanes middle_m, right, down;
  Lanes most_m;           // infinite: not asked for
  Eigen::Vector2i where;  // in the window: the latest that was found
};

// Cells whose bounds say that they hold nothing farther are not looked into.
void GroundWindow::find_farthest(Farthest& lanes) const {
  constexpr double kRounding_m = 1e-9;
  const Lanes at_left = lanes.middle_m - lanes.right * (lanes.x + Lanes::LinSpaced(0, kLanes - 1));
  const std::span<const FootprintRow> rows(footprint_.rows);
  for (std::size_t first = 0; first < rows.size();) {
    // The rows that are in one row of cells.
    const int cell_row = (lanes.y + rows[first].row) / kCell;
    std::size_t past_last = first;
    int from = rows[first].first, to = rows[first].past_last;
    for (; past_last < rows.size() && (lanes.y + rows[past_last].row) / kCell == cell_row; ++past_last)
      from = std::min(from, rows[past_last].first), to = std::max(to, rows[past_last].past_last);
    const Lanes of_row = at_left + lanes.down * (cell_row * kCell + kMiddle - lanes.y);
    const int last = std::min((lanes.x + kLanes - 1 + to - 1) / kCell, cells_across_ - 1);
    for (int column = (lanes.x + from) / kCell; column <= last; ++column) {
      const Cell& cell = cells_[static_cast<std::size_t>(cell_row * cells_across_ + column)];
      const Lanes there = of_row + lanes.right * (column * kCell + kMiddle);
      const Lanes within =
          ((cell.plane.right - lanes.right).abs() + (cell.plane.down - lanes.down).abs()) * kMiddle + kRounding_m;
      const Lanes at_most_m = (cell.most - there).max(there - cell.least) + within;
      if (!((at_most_m - lanes.most_m).maxCoeff() > 0)) continue;
      for (int i = 0; i < kLanes; ++i)
        if (at_most_m[i] > lanes.most_m[i]) look_into(column, rows.subspan(first, past_last - first), i, lanes);
    }
    first = past_last;
  }
}

// At as many pixels of each row at once as a cell has: at others that are covered where some of the cell's are not.
void GroundWindow::look_into(int column, std::span<const FootprintRow> rows, int lane, Farthest& lanes) const {
  const int x = lanes.x + lane, left = column * kCell - x;
  const Lanes steps = lanes.right[lane] * Lanes::LinSpaced(0, kLanes - 1);
  double most_m = lanes.most_m[lane];
  for (const FootprintRow& r : rows) {
    if (r.past_last <= left || r.first >= left + kCell) continue;
    const int first = std::max(r.first, std::min(left, r.past_last - kLanes)), n = r.past_last - first;
    const double there = lanes.middle_m[lane] + lanes.down[lane] * r.row + lanes.right[lane] * first;
    Lanes off_m = (Eigen::Map<const Lanes>(&heights_[index(x + first, lanes.y + r.row)]) - there - steps).abs();
    if (n < kLanes) off_m = (Lanes::LinSpaced(0, kLanes - 1) < n).select(off_m, 0);
    if (!(off_m.maxCoeff() > most_m)) continue;
    int where = 0;
    most_m = off_m.maxCoeff(&where);
    lanes.where = {x + first + where, lanes.y + r.row};
  }
  if (most_m > lanes.most_m[lane]) look_at(lanes.where, lanes);
}

// What is far from one plane is far from its neighbours.
void GroundWindow::look_at(const Eigen::Vector2i& where, Farthest& lanes) const {
  const int row = where.y() - lanes.y - footprint_.rows.front().row;
  if (row < 0 || row >= static_cast<int>(footprint_.rows.size())) return;
  const FootprintRow& r = footprint_.rows[static_cast<std::size_t>(row)];
  const double height_m = height(where.x(), where.y());
  for (int i = 0; i < kLanes; ++i) {
    const int dx = where.x() - lanes.x - i;
    if (dx < r.first || dx >= r.past_last) continue;
    const double there = lanes.middle_m[i] + lanes.down[i] * r.row + lanes.right[i] * dx;
    lanes.most_m[i] = std::max(lanes.most_m[i], std::abs(height_m - there));
  }
}

// Distances from the planes; those that are not farther than what `farthest_m` has stay. Nothing of NaN planes.
void GroundWindow::find_roughness(int row, std::span<const Plane> planes, std::span<double> farthest_m) const {
  const int n = static_cast<int>(farthest_m.size());
  Farthest lanes{square_.x - left_, square_.y - top_ + row, {}, {}, {}, {}, {0, 0}};
  for (int first = 0; first < n; first += kLanes, lanes.x += kLanes) {
    lanes.middle_m = lanes.right = lanes.down = 0;
    lanes.most_m = std::numeric_limits<double>::infinity();
    for (int i = 0; i < std::min(kLanes, n - first); ++i) {
      const Plane& plane = planes[static_cast<std::size_t>(first + i)];
      if (std::isnan(plane.height_m)) continue;
      lanes.middle_m[i] = plane.height_m;
      lanes.right[i] = plane.right;
      lanes.down[i] = plane.down;
      lanes.most_m[i] = farthest_m[static_cast<std::size_t>(first + i)];
    }
    look_at(lanes.where, lanes);
    find_farthest(lanes);
    for (int i = 0; i < std::min(kLanes, n - first); ++i)
      if (!std::isinf(lanes.most_m[i])) farthest_m[static_cast<std::size_t>(first + i)] = lanes.most_m[i];
  }
}

void GroundWindow::measure(int row, std::span<FootprintMeasures> out) const {
  std::vector<Plane> planes(out.size());
  std::vector<int> missing(out.size()), rocks(out.size()), high(out.size());
  if (footprint_.pads.empty())
    fit_all(row, planes);
  else
    fit_pads(row, planes);
  count(missing_, row, missing);
  count(rocks_, row, rocks);
  count(high_, row, high);
  const Eigen::Matrix2d to_gradient = footprint_.metres_per_px.transpose().inverse();
  std::vector<double> gradient(out.size()), farthest_m(out.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    gradient[i] = (to_gradient * Eigen::Vector2d(planes[i].right + trend_.right, planes[i].down + trend_.down)).norm();
    // A little nearer: what isn't farther must not come out as more than the limit by rounding.
    farthest_m[i] = roughness_above_m_.value_or(0) * (1 - 1e-12) * std::sqrt(1 + gradient[i] * gradient[i]);
  }
  if (roughness_above_m_) find_roughness(row, planes, farthest_m);
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
