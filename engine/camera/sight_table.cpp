#include "engine/camera/sight_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "dem/base/error.h"
#include "dem/base/hash.h"

namespace selenograph::engine {
namespace {

constexpr double kSteepest = 10;  // slope of 84 degrees
constexpr double kBeyond = 0.5;   // of the image's extent, on each side

// Weights of Keys's cubic convolution for four nodes, between the second and the third, and their derivatives.
struct CubicWeights {
  std::array<double, 4> value, derivative;

  explicit CubicWeights(double t)
      : value{t * (-0.5 + t * (1 - 0.5 * t)), 1 + t * t * (-2.5 + 1.5 * t), t * (0.5 + t * (2 - 1.5 * t)),
              t * t * (-0.5 + 0.5 * t)},
        derivative{-0.5 + t * (2 - 1.5 * t), t * (-5 + 4.5 * t), 0.5 + t * (4 - 4.5 * t), t * (-1 + 1.5 * t)} {}
};

}  // namespace

SightTable::SightTable(std::string name, std::size_t columns, std::size_t rows, const std::vector<Vec3>& directions,
                       const std::string& file)
    : name_(std::move(name)),
      nodes_{static_cast<std::ptrdiff_t>(columns), static_cast<std::ptrdiff_t>(rows)},
      fingerprint_(dem::hash_of(directions.data(), directions.size() * sizeof directions[0])) {
  if (columns < 2 || rows < 2)
    throw DataError(file, fmt::format("has {} x {} lines of sight; at least 2 x 2 are needed", columns, rows));
  slopes_.reserve(directions.size());
  for (const Vec3& d : directions) {
    const Vec2 slope = d.xy() / d.z();
    if (!(d.is_finite() && d.z() > 0 && slope.norm() <= kSteepest))
      throw DataError(file, fmt::format("line of sight at column {}, row {} is ({:.6g}, {:.6g}, {:.6g}); it must point "
                                        "along +z, the boresight, within 84 degrees",
                                        slopes_.size() % columns, slopes_.size() / columns, d.x(), d.y(), d.z()));
    slopes_.push_back(slope);
  }
  fit(file);
  check_one_to_one(file);
}

// Fits x = u / focal and y = v / focal for columns and rows apart: a pinhole's x does not depend on the row.
void SightTable::fit(const std::string& file) {
  for (int axis = 0; axis < 2; ++axis) {
    const auto n = static_cast<double>(nodes_[static_cast<std::size_t>(axis)]);
    double sum = 0, moment = 0, variance = 0;
    for (std::ptrdiff_t i = 0; i < static_cast<std::ptrdiff_t>(slopes_.size()); ++i) {
      const double along = static_cast<double>(axis == 0 ? i % nodes_[0] : i / nodes_[0]) - (n - 1) / 2;
      sum += slopes_[static_cast<std::size_t>(i)][axis];
      moment += along * slopes_[static_cast<std::size_t>(i)][axis];
      variance += along * along;
    }
    span_[axis] = moment / variance * (n - 1);
    first_[axis] = sum / static_cast<double>(slopes_.size()) - span_[axis] / 2;
    if (!(span_[axis] > 0))
      throw DataError(file,
                      fmt::format("lines of sight do not turn toward +{} from {} to {}: they are in camera axes, "
                                  "+x right, +y down",
                                  axis == 0 ? 'x' : 'y', axis == 0 ? "left" : "top", axis == 0 ? "right" : "bottom"));
  }
}

// Looks at the derivative at the nodes and between them, and beyond the border, where it is that of the border.
void SightTable::check_one_to_one(const std::string& file) {
  constexpr double kLargestScale = 10;
  for (std::ptrdiff_t j = 0; j <= 2 * (nodes_[1] - 1); ++j)
    for (std::ptrdiff_t i = 0; i <= 2 * (nodes_[0] - 1); ++i) {
      const double right = static_cast<double>(i) / static_cast<double>(2 * (nodes_[0] - 1)),
                   down = static_cast<double>(j) / static_cast<double>(2 * (nodes_[1] - 1));
      const Sight here = sight(first_ + Vec2(right * span_.x(), down * span_.y()));
      const Mat2& d = here.derivative;
      if (!(d.determinant() > 0 && d.trace() > 0 && d.inverse().norm() < kLargestScale && d.norm() < kLargestScale))
        throw DataError(file,
                        fmt::format("lines of sight fold, or bunch, at column {}, row {}: neighbours must be apart "
                                    "as in an image",
                                    i / 2, j / 2));
      const bool at_border = i == 0 || j == 0 || i == 2 * (nodes_[0] - 1) || j == 2 * (nodes_[1] - 1);
      if (at_border) {
        const Vec2 shift(std::abs(d(0, 0)) * span_.x() + std::abs(d(0, 1)) * span_.y(),
                         std::abs(d(1, 0)) * span_.x() + std::abs(d(1, 1)) * span_.y());
        reach_ = std::max(reach_, here.position.norm() + kBeyond * shift.norm());
      }
    }
}

// Returns a node's slope; beyond the border, that of the parabola through the last three nodes.
Vec2 SightTable::node(std::ptrdiff_t column, std::ptrdiff_t row) const {
  const auto extrapolated = [](std::ptrdiff_t i, std::ptrdiff_t n, const auto& at) -> Vec2 {
    if (i >= 0 && i < n) return at(i);
    const std::ptrdiff_t end = i < 0 ? 0 : n - 1, inward = i < 0 ? 1 : -1;
    if (n == 2) return 2 * at(end) - at(end + inward);
    return 3 * at(end) - 3 * at(end + inward) + at(end + 2 * inward);
  };
  return extrapolated(row, nodes_[1], [&](std::ptrdiff_t j) {
    return extrapolated(column, nodes_[0],
                        [&](std::ptrdiff_t i) -> Vec2 { return slopes_[static_cast<std::size_t>(j * nodes_[0] + i)]; });
  });
}

SightTable::Sight SightTable::sight(const Vec2& image) const {
  const Vec2 last(static_cast<double>(nodes_[0] - 1), static_cast<double>(nodes_[1] - 1));
  const Vec2 per_unit(last.x() / span_.x(), last.y() / span_.y()), from_first = image - first_;
  const Vec2 at(from_first.x() * per_unit.x(), from_first.y() * per_unit.y());
  const Vec2 inside = min_of(max_of(at, Vec2::zero()), last);
  const Vec2 cell = min_of({std::floor(inside.x()), std::floor(inside.y())}, last - Vec2(1, 1));
  const CubicWeights right(inside.x() - cell.x()), down(inside.y() - cell.y());
  Sight s{Vec2::zero(), Mat2::zero()};
  for (std::ptrdiff_t j = 0; j < 4; ++j)
    for (std::ptrdiff_t i = 0; i < 4; ++i) {
      const auto x = static_cast<std::size_t>(i), y = static_cast<std::size_t>(j);
      const Vec2 slope =
          node(static_cast<std::ptrdiff_t>(cell.x()) - 1 + i, static_cast<std::ptrdiff_t>(cell.y()) - 1 + j);
      s.position += right.value[x] * down.value[y] * slope;
      s.derivative.col(0) += right.derivative[x] * down.value[y] * slope;
      s.derivative.col(1) += right.value[x] * down.derivative[y] * slope;
    }
  s.position += s.derivative * (at - inside);
  for (int axis = 0; axis < 2; ++axis) s.derivative.col(axis) *= per_unit[axis];
  return s;
}

bool SightTable::is_near(const Vec2& image) const {
  const Vec2 from_middle = image - first_ - span_ / 2, reach = (0.5 + kBeyond) * span_;
  return std::abs(from_middle.x()) <= reach.x() && std::abs(from_middle.y()) <= reach.y();
}

std::optional<Vec2> SightTable::plane(const Vec2& image) const {
  if (!is_near(image)) return std::nullopt;
  return sight(image).position;
}

// Newton's method from the pinhole's position, which the table distorts a little.
std::optional<Vec2> SightTable::image(const Vec2& plane) const {
  Vec2 at = plane;
  constexpr int kMaxSteps = 50;
  for (int i = 0; i < kMaxSteps; ++i) {
    at = min_of(max_of(first_ - kBeyond * span_, at), first_ + (1 + kBeyond) * span_);
    const Sight here = sight(at);
    const Vec2 step = here.derivative.inverse() * (plane - here.position);
    at += step;
    if (step.norm() <= 1e-15 * (1 + at.norm())) break;
  }
  if (!is_near(at) || !((sight(at).position - plane).norm() <= 1e-11 * (1 + plane.norm()))) return std::nullopt;
  return at;
}

Mat2 SightTable::jacobian(const Vec2& plane) const { return sight(image(plane).value_or(plane)).derivative.inverse(); }

void set_sights(std::shared_ptr<const SightTable> sights, Camera& camera) {
  camera.fx = sights->focal_px(0, camera.width);
  camera.fy = sights->focal_px(1, camera.height);
  camera.cx = sights->centre_px(0, camera.width);
  camera.cy = sights->centre_px(1, camera.height);
  camera.sights = std::move(sights);
}

}  // namespace selenograph::engine
