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
    : footprint_(footprint), square_(square), roughness_(limits.roughness) {
  int left = 0, right = 0;
  for (const FootprintRow& r : footprint.rows) {
    left = std::max(left, -r.first), right = std::max(right, r.past_last - 1), covered_ += r.past_last - r.first;
  }
  int up = std::max(0, -footprint.rows.front().row), down = std::max(0, footprint.rows.back().row);
  for (const Eigen::Vector2i& pad : footprint.pads) {
    left = std::max(left, -pad.x()), right = std::max(right, pad.x());
    up = std::max(up, -pad.y()), down = std::max(down, pad.y());
  }
  left_ = square.x - left, top_ = square.y - up;
  width_ = square.width + left + right, height_ = square.height + up + down;
  if (left_ < 0 || top_ < 0 || left_ + width_ > width || top_ + height_ > height)
    throw std::logic_error("a footprint reaches beyond what was drawn");
  find_trend(products, static_cast<std::size_t>(width));
  sum_rows(products, static_cast<std::size_t>(width), limits);
  if (roughness_) bound_cells();
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
  heights_.resize(rows * static_cast<std::size_t>(width_));
  const auto make = [&](auto& sums) { sums.all.resize(rows * stride), sums.stride = stride; };
  make(sum_), make(moment_), make(missing_);
  const bool rocks = !products.rock_height.empty();
  if (rocks) make(rocks_), make(high_);
  for (int y = 0; y < height_; ++y) {
    const std::size_t row = static_cast<std::size_t>(y) * stride;
    for (int x = 0; x < width_; ++x) {
      const double given_m = products.height[at(x, y)];
      const bool none = std::isnan(given_m);
      const double height_m = none ? 0 : given_m - trend_.height_m - trend_.right * x - trend_.down * y;
      heights_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x)] = height_m;
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
}

void GroundWindow::bound_cells() {
  cells_across_ = (width_ + kCell - 1) / kCell;
  cells_.assign(static_cast<std::size_t>(cells_across_ * ((height_ + kCell - 1) / kCell)),
                {std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()});
  for (int y = 0; y < height_; ++y)
    for (int x = 0; x < width_; ++x) {
      Cell& cell = cells_[static_cast<std::size_t>(y / kCell * cells_across_ + x / kCell)];
      cell.least = std::min(cell.least, height(x, y)), cell.most = std::max(cell.most, height(x, y));
    }
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
      sum[i] += heights, down[i] += below * heights;
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

// The largest distance from the plane, vertically. Cells whose bounds say that they hold nothing farther are not looked
// into. `where`: an offset that is looked at first, and where it was found.
double GroundWindow::farthest(const Plane& plane, int x, int y, Eigen::Vector2i& where) const {
  double most = std::abs(off(plane, x, y, where.x(), where.y()));
  const double slack = (std::abs(plane.right) + std::abs(plane.down)) * (kCell - 1) / 2;
  constexpr double kMiddle = (kCell - 1) / 2.0;
  const std::vector<FootprintRow>& rows = footprint_.rows;
  for (std::size_t first = 0; first < rows.size();) {
    // The rows that are in one row of cells.
    const int cell_row = (y + rows[first].row) / kCell;
    std::size_t past_last = first;
    int left = rows[first].first, right = rows[first].past_last;
    for (; past_last < rows.size() && (y + rows[past_last].row) / kCell == cell_row; ++past_last)
      left = std::min(left, rows[past_last].first), right = std::max(right, rows[past_last].past_last);
    for (int column = (x + left) / kCell; column <= (x + right - 1) / kCell; ++column) {
      const Cell& cell = cells_[static_cast<std::size_t>(cell_row * cells_across_ + column)];
      const double there =
          plane.height_m + plane.right * (column * kCell + kMiddle - x) + plane.down * (cell_row * kCell + kMiddle - y);
      if (std::max(cell.most - there, there - cell.least) + slack <= most) continue;
      for (std::size_t r = first; r < past_last; ++r) {
        const int from = std::max(rows[r].first, column * kCell - x),
                  to = std::min(rows[r].past_last, (column + 1) * kCell - x);
        for (int dx = from; dx < to; ++dx) {
          const double distance = std::abs(off(plane, x, y, dx, rows[r].row));
          if (distance > most) most = distance, where = {dx, rows[r].row};
        }
      }
    }
    first = past_last;
  }
  return most;
}

void GroundWindow::measure(int row, std::span<FootprintMeasures> out) const {
  std::vector<Plane> planes(out.size());
  std::vector<int> missing(out.size()), rocks(out.size()), high(out.size());
  if (footprint_.pads.empty())
    fit_all(row, planes);
  else
    fit_pads(row, planes);
  count(missing_, row, missing), count(rocks_, row, rocks), count(high_, row, high);
  const Eigen::Matrix2d to_gradient = footprint_.metres_per_px.transpose().inverse();
  Eigen::Vector2i where(0, footprint_.rows[footprint_.rows.size() / 2].row);
  where.x() = footprint_.rows[footprint_.rows.size() / 2].first;
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = {};
    if (missing[i] > 0) continue;
    const double gradient =
        (to_gradient * Eigen::Vector2d(planes[i].right + trend_.right, planes[i].down + trend_.down)).norm();
    out[i].slope_deg = std::atan(gradient) * kDegreesPerRadian;
    if (roughness_)
      out[i].roughness_m = farthest(planes[i], square_.x - left_ + static_cast<int>(i), square_.y - top_ + row, where) /
                           std::hypot(1.0, gradient);
    out[i].rock_cover = static_cast<double>(rocks[i]) / covered_;
    out[i].high_rocks = high[i];
  }
}

}  // namespace selenograph::engine
