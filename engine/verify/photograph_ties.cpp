#include "engine/verify/photograph_ties.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

namespace selenograph::engine {
namespace {

// A square window of an image: its values minus their mean, and their norm.
struct Window {
  std::vector<double> values;
  double norm = 0;
};

Window window_at(const GreyImage& image, int x, int y, int half) {
  Window window;
  double sum = 0;
  for (int row = y - half; row <= y + half; ++row)
    for (int column = x - half; column <= x + half; ++column) {
      window.values.push_back(image.at(column, row));
      sum += window.values.back();
    }
  double squares = 0;
  for (double& value : window.values) {
    value -= sum / static_cast<double>(window.values.size());
    squares += value * value;
  }
  window.norm = std::sqrt(squares);
  return window;
}

// Returns the correlation of a window of no mean with the image around a pixel.
double correlation_at(const GreyImage& image, int x, int y, int half, const Window& window) {
  double sum = 0, squares = 0, products = 0;
  const double* expected = window.values.data();
  for (int row = y - half; row <= y + half; ++row) {
    const double* value = &image.values[image.index(x - half, row)];
    for (int k = 0; k <= 2 * half; ++k, ++value, ++expected) {
      sum += *value;
      squares += *value * *value;
      products += *value * *expected;
    }
  }
  const double variance = squares - sum * sum / static_cast<double>(window.values.size());
  return variance > 0 && window.norm > 0 ? products / (std::sqrt(variance) * window.norm) : 0;
}

// Returns the offset of a parabola's maximum through three values at -1, 0 and 1.
double parabola_peak(double before, double middle, double after) {
  return (after - before) / (2 * (2 * middle - after - before));
}

// Returns where a window of the frame lies in the photograph; empty: nowhere within the search.
std::optional<std::pair<PixelXY, double>> find_window(const GreyImage& photograph, const Window& window, int x, int y,
                                                      int half, int search_px) {
  const int side = 2 * search_px + 1;
  std::vector<double> found;
  for (int dy = -search_px; dy <= search_px; ++dy)
    for (int dx = -search_px; dx <= search_px; ++dx)
      found.push_back(correlation_at(photograph, x + dx, y + dy, half, window));
  const int best = static_cast<int>(std::max_element(found.begin(), found.end()) - found.begin());
  const int column = best % side, row = best / side;
  if (column == 0 || row == 0 || column == side - 1 || row == side - 1) return std::nullopt;
  const auto at = [&](int k) { return found[static_cast<std::size_t>(k)]; };
  return std::pair(PixelXY{x + column - search_px + parabola_peak(at(best - 1), at(best), at(best + 1)),
                           y + row - search_px + parabola_peak(at(best - side), at(best), at(best + side))},
                   at(best));
}

// Returns the share of the window's pixels that the mask includes.
double covered(const GreyImage& image, const PixelMask& mask, int x, int y, int half) {
  int number = 0;
  for (int row = y - half; row <= y + half; ++row)
    for (int column = x - half; column <= x + half; ++column) number += mask[image.index(column, row)] ? 1 : 0;
  return number / std::pow(2.0 * half + 1, 2);
}

Vec3 ground_at(std::span<const double> position, std::size_t pixel) {
  return {position[3 * pixel], position[3 * pixel + 1], position[3 * pixel + 2]};
}

// The free parameters as one vector, in units in which a pixel's change is of the order of one.
class Parameters {
 public:
  Parameters(const CameraView& start, const FreeParameters& free) : start_(start), free_(free) {}

  int count() const {
    return 3 + (free_.position ? 3 : 0) + (free_.focal_length ? 1 : 0) + (free_.aspect ? 1 : 0) +
           (free_.principal_point ? 2 : 0) + (free_.k1 ? 1 : 0);
  }

  CameraView view(const Eigen::VectorXd& q) const {
    CameraView out = start_;
    int next = 0;
    const auto take = [&] { return q[next++]; };
    const auto take_vector = [&] {
      const Vec3 v = q.segment<3>(next);
      next += 3;
      return v;
    };
    const Vec3 turn_rad = 1e-3 * take_vector();
    const double angle_rad = turn_rad.norm();
    if (angle_rad > 0)
      out.pose.camera_from_moon =
          (Eigen::AngleAxisd(angle_rad, turn_rad / angle_rad) * start_.pose.camera_from_moon).normalized();
    if (free_.position) out.pose.position_m += kPositionUnit_m * take_vector();
    if (free_.focal_length) {
      const double factor = 1 + 1e-3 * take();
      out.camera.fx *= factor;
      out.camera.fy *= factor;
    }
    if (free_.aspect) out.camera.fy *= 1 + 1e-3 * take();
    if (free_.principal_point) {
      out.camera.cx += take();
      out.camera.cy += take();
    }
    if (free_.k1) out.camera.distortion.k1 += 1e-3 * take();
    return out;
  }

  // Returns the inverse variances that bind parameters to zero; 0: unbound.
  Eigen::VectorXd bonds() const {
    constexpr double kPositionSigma_m = 300, kPrincipalPointSigma_px = 1.5;
    Eigen::VectorXd out = Eigen::VectorXd::Zero(count());
    int next = 3;
    if (free_.position) {
      out.segment<3>(next).setConstant(std::pow(kPositionUnit_m / kPositionSigma_m, 2));
      next += 3;
    }
    next += (free_.focal_length ? 1 : 0) + (free_.aspect ? 1 : 0);
    if (free_.principal_point) out.segment<2>(next).setConstant(std::pow(1 / kPrincipalPointSigma_px, 2));
    return out;
  }

 private:
  static constexpr double kPositionUnit_m = 1000;
  CameraView start_;
  FreeParameters free_;
};

// Returns projected ground minus photograph, two per tie; 0 for ground that the view does not image.
Eigen::VectorXd residuals_px(const CameraView& at, std::span<const Tie> ties) {
  const View view(at.camera, at.pose);
  Eigen::VectorXd out = Eigen::VectorXd::Zero(2 * static_cast<Eigen::Index>(ties.size()));
  for (std::size_t k = 0; k < ties.size(); ++k)
    if (const auto projected = view.project(ties[k].ground_m)) {
      out[static_cast<Eigen::Index>(2 * k)] = projected->x - ties[k].photograph.x;
      out[static_cast<Eigen::Index>(2 * k + 1)] = projected->y - ties[k].photograph.y;
    }
  return out;
}

std::vector<Tie> ties_of(std::span<const Tie> ties, bool held_out) {
  std::vector<Tie> out;
  std::copy_if(ties.begin(), ties.end(), std::back_inserter(out),
               [&](const Tie& tie) { return tie.held_out == held_out; });
  return out;
}

}  // namespace

TieGrid tie_grid(int width, int height) {
  const double side = std::min(width, height);
  return {static_cast<int>(std::lround(side / 20)), static_cast<int>(std::lround(side / 25)), side / 33};
}

std::vector<Tie> find_ties(const GreyImage& photograph, const GreyImage& radiance, std::span<const double> position,
                           int search_px) {
  constexpr double kMinCovered = 0.98;
  constexpr int kMinHalf_px = 3;
  const TieGrid grid = tie_grid(radiance.width, radiance.height);
  PixelMask everywhere(radiance.values.size(), 1), ground(radiance.values.size());
  // The root compresses bright slopes as film does, so that windows do not follow their brightest pixels alone.
  GreyImage root = radiance;
  for (std::size_t i = 0; i < root.values.size(); ++i) {
    ground[i] = std::isfinite(position[3 * i]) ? 1 : 0;
    root.values[i] = std::sqrt(std::max(0.0, root.values[i]));
  }
  const GreyImage expected = locally_normalised(root, everywhere, grid.normalised_px),
                  observed = locally_normalised(photograph, everywhere, grid.normalised_px);
  std::vector<Tie> ties;
  if (grid.half_px < kMinHalf_px) return ties;
  const int border = grid.half_px + search_px;
  for (int y = border, row = 0; y < root.height - border; y += grid.step_px, ++row)
    for (int x = border, column = 0; x < root.width - border; x += grid.step_px, ++column) {
      if (!ground[root.index(x, y)] || covered(root, ground, x, y, grid.half_px) < kMinCovered) continue;
      const Window window = window_at(expected, x, y, grid.half_px);
      const auto found = find_window(observed, window, x, y, grid.half_px, search_px);
      if (found && found->second >= grid.min_correlation)
        ties.push_back({{static_cast<double>(x), static_cast<double>(y)},
                        found->first,
                        ground_at(position, root.index(x, y)),
                        found->second,
                        (row + column) % 2 == 1});
    }
  return ties;
}

CameraView fitted_view(const CameraView& start, const FreeParameters& free, std::span<const Tie> ties) {
  constexpr std::size_t kMinTies = 8;
  constexpr double kLoss_px = 0.5, kStep = 1e-4;
  constexpr int kIterations = 20;
  const std::vector<Tie> fitted = ties_of(ties, false);
  if (fitted.size() < kMinTies) throw std::runtime_error("fewer than 8 tie points: the view is too far off");
  const Parameters parameters(start, free);
  const Eigen::VectorXd bonds = parameters.bonds();
  Eigen::VectorXd q = Eigen::VectorXd::Zero(parameters.count());
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    const Eigen::VectorXd r = residuals_px(parameters.view(q), fitted);
    Eigen::MatrixXd jacobian(r.size(), q.size());
    for (Eigen::Index k = 0; k < q.size(); ++k) {
      Eigen::VectorXd more = q, less = q;
      more[k] += kStep;
      less[k] -= kStep;
      jacobian.col(k) =
          (residuals_px(parameters.view(more), fitted) - residuals_px(parameters.view(less), fitted)) / (2 * kStep);
    }
    const Eigen::VectorXd weights = (1 + (r / kLoss_px).array().square()).rsqrt();
    Eigen::MatrixXd normal = jacobian.transpose() * weights.asDiagonal() * jacobian;
    normal.diagonal() += bonds;
    const Eigen::VectorXd step =
        normal.ldlt().solve(-(jacobian.transpose() * weights.asDiagonal() * r + bonds.cwiseProduct(q)));
    q += step;
    if (step.norm() < 1e-9) break;
  }
  return parameters.view(q);
}

std::vector<double> tie_distances_px(const CameraView& view, std::span<const Tie> ties, bool held_out) {
  const Eigen::VectorXd r = residuals_px(view, ties_of(ties, held_out));
  std::vector<double> out;
  for (Eigen::Index k = 0; k < r.size(); k += 2) out.push_back(std::hypot(r[k], r[k + 1]));
  return out;
}

}  // namespace selenograph::engine
