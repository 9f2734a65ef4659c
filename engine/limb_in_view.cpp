#include "engine/limb_in_view.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>

#include "dem/support/parallel.h"
#include "engine/camera/row_views.h"
#include "engine/ray_queries.h"
#include "engine/scene/ray_selection.h"
#include "engine/scene/selection.h"

namespace selenograph::engine {
namespace {

// Terrain has one height at each place, so in a half plane through the Moon's centre all rays between the centre and
// the limb hit, and none beyond it: the border is found by bisection. What is costly are scenes, so the way to the
// border is in two steps: from outside in by bounds on heights, without a scene, and then by fans of rays that are as
// wide as the relief of the blocks found. One scene holds what all rays of a fan may meet.
class LimbFinder {
 public:
  LimbFinder(const LimbRequest& request, const dem::Terrain& terrain, RenderCache& kept, const StopToken& stop)
      : terrain_(terrain),
        kept_(kept),
        stop_(stop),
        views_(request.camera, request.pose, std::nullopt, stop),
        view_(views_.reference()),
        from_m_(view_.position()),
        distance_m_(from_m_.norm()),
        center_(-from_m_ / distance_m_) {
    refuse_underground(terrain, views_, stop);
    const auto turn = Eigen::Quaterniond::FromTwoVectors(view_.moon_from_camera().col(2), center_);
    right_ = turn * view_.moon_from_camera().col(0), down_ = turn * view_.moon_from_camera().col(1);
    limbs_.resize(static_cast<std::size_t>(request.points));
    for (std::size_t i = 0; i < limbs_.size(); ++i)
      limbs_[i].azimuth_rad = 2 * std::numbers::pi * static_cast<double>(i) / request.points;
  }

  std::vector<LimbPoint> find() {
    come_near();
    while (cast_fans()) stop_.check();
    std::vector<LimbPoint> points(limbs_.size());
    in_parallel(points.size(), [&](std::size_t i) {
      stop_.check();
      points[i] = point_of(i);
    });
    return points;
  }

 private:
  struct Limb {
    double azimuth_rad = 0;
    double outer_rad = 0;  // rays at this angle from the centre and beyond meet nothing
    double width_rad = 0;  // of the fan within it that is cast next; 0: nothing is left to cast
    std::optional<FanBorder> border{};
  };

  static constexpr double kHighest_m = kMoonRadius_m + double{dem::kHighestRelief_m} + 1,
                          kDeepest_m = kMoonRadius_m + double{dem::kLowestRelief_m} - 1;

  Vec3 aside(double azimuth_rad) const { return std::cos(azimuth_rad) * right_ + std::sin(azimuth_rad) * down_; }
  Vec3 direction(double azimuth_rad, double angle_rad) const {
    return std::cos(angle_rad) * center_ + std::sin(angle_rad) * aside(azimuth_rad);
  }
  // Of a sphere's limb; straight up from within it.
  double angle_of(double radius_m) const {
    return radius_m < distance_m_ ? std::asin(radius_m / distance_m_) : std::numbers::pi;
  }
  // At it terrain is met everywhere.
  double innermost_rad() const { return std::asin(std::min(1.0, kDeepest_m / distance_m_)); }
  double to_limb_m() const {
    const double square = distance_m_ * distance_m_ - kMoonRadius_m * kMoonRadius_m;
    return std::sqrt(std::max(square, 1e6));
  }
  // Farther away a ray is above all terrain.
  double reach_m() const { return to_limb_m() + std::sqrt(kHighest_m * kHighest_m - kDeepest_m * kDeepest_m); }

  void come_near() {
    constexpr int kSteps = 256;
    const double outermost = angle_of(kHighest_m), step = (outermost - innermost_rad()) / kSteps;
    std::vector<std::size_t> left(limbs_.size());
    for (std::size_t i = 0; i < left.size(); ++i) left[i] = i, limbs_[i].outer_rad = outermost;
    for (int k = 1; k <= kSteps && !left.empty(); ++k) {
      stop_.check();
      const double angle = outermost - k * step;
      std::vector<Ray> rays;
      for (const std::size_t i : left) rays.push_back({from_m_, direction(limbs_[i].azimuth_rad, angle)});
      const auto met = select_for_rays(terrain_, rays, SIZE_MAX, stop_);
      for (const BlockOnRays& block : *met)
        for (const std::size_t r : block.rays) {
          double& width = limbs_[left[r]].width_rad;
          width = std::max(width, step + (block.high_m - block.low_m) / to_limb_m());
        }
      std::erase_if(left, [&](std::size_t i) {
        if (limbs_[i].width_rad > 0) return true;
        limbs_[i].outer_rad = angle;
        return false;
      });
    }
    in_parallel(limbs_.size(), [&](std::size_t i) {
      Limb& limb = limbs_[i];
      constexpr double kBelow_m = 0.5;
      if (const double seen = seen_rad(limb); limb.width_rad > 0 && seen > innermost_rad())
        limb.width_rad = std::max(limb.outer_rad - seen, 0.0) + kBelow_m / to_limb_m();
    });
  }

  // Angle from the centre of the highest of some places of the terrain near the limb: a ray there hits. 0: no data.
  double seen_rad(const Limb& limb) const {
    const Vec3 along = direction(limb.azimuth_rad, limb.outer_rad), out = aside(limb.azimuth_rad);
    double best_m = -from_m_.dot(along), best_rad = 0;
    const auto look = [&](double half_m, int steps) {
      const double middle_m = best_m;
      for (int k = -steps; k <= steps; ++k) {
        const double at_m = middle_m + half_m * k / steps;
        if (at_m <= 0) continue;
        Geographic g = to_geographic(from_m_ + at_m * along);
        g.height_m = terrain_.height(g.lat_deg, g.lon_deg, stop_).height_m;
        const Vec3 to = to_cartesian(g) - from_m_;
        const double angle = std::atan2(to.dot(out), to.dot(center_));
        if (angle > best_rad) best_rad = angle, best_m = at_m;
      }
    };
    look(80e3, 40), look(2e3, 16);
    return best_rad;
  }

  // Whether something is left to cast.
  bool cast_fans() {
    std::vector<RayFan> fans;
    std::vector<std::size_t> asked;
    for (std::size_t i = 0; i < limbs_.size(); ++i) {
      Limb& limb = limbs_[i];
      if (limb.width_rad == 0) continue;
      limb.width_rad = std::min(limb.width_rad, limb.outer_rad - innermost_rad());
      const double inner = limb.outer_rad - limb.width_rad;
      const Vec3 out = aside(limb.azimuth_rad);
      fans.push_back({from_m_, direction(limb.azimuth_rad, inner), std::cos(inner) * out - std::sin(inner) * center_,
                      limb.width_rad, reach_m()});
      asked.push_back(i);
    }
    if (fans.empty()) return false;
    constexpr double kTolerance_px = 1e-3;
    const auto borders = find_borders(fans, kTolerance_px / view_.pixels_per_metre_from(1), terrain_, kept_, stop_);
    for (std::size_t k = 0; k < fans.size(); ++k) {
      Limb& limb = limbs_[asked[k]];
      limb.outer_rad -= limb.width_rad;
      limb.border = borders[k];
      const bool over = limb.border || limb.outer_rad <= innermost_rad() * (1 + 1e-12);
      limb.width_rad = over ? 0 : 2 * limb.width_rad;
      if (limb.border) limb.outer_rad += limb.border->angle_rad;
    }
    return true;
  }

  // Whether there is data below a ray wherever it is below the highest terrain.
  bool data_below(const Vec3& direction) const {
    constexpr int kPlaces = 32;
    const double closest_m = -from_m_.dot(direction), height_m = (from_m_ + closest_m * direction).norm(),
                 half_m = std::sqrt(std::max(0.0, kHighest_m * kHighest_m - height_m * height_m));
    const double first_m = std::max(0.0, closest_m - half_m), last_m = closest_m + half_m;
    for (int k = 0; k <= kPlaces; ++k) {
      const Geographic g = to_geographic(from_m_ + (first_m + (last_m - first_m) * k / kPlaces) * direction);
      if (std::isnan(terrain_.height(g.lat_deg, g.lon_deg, stop_).height_m)) return false;
    }
    return true;
  }

  LimbPoint point_of(std::size_t index) const {
    const Limb& limb = limbs_[index];
    LimbPoint point;
    point.azimuth_deg = 360.0 * static_cast<double>(index) / static_cast<double>(limbs_.size());
    if (distance_m_ > kMoonRadius_m) {
      const double angle = angle_of(kMoonRadius_m);
      point.sphere_angle_deg = angle * kDegreesPerRadian;
      if (const auto pixel = view_.project(from_m_ + to_limb_m() * direction(limb.azimuth_rad, angle)))
        point.sphere_x_px = pixel->x, point.sphere_y_px = pixel->y;
    }
    const Vec3 along = direction(limb.azimuth_rad, limb.outer_rad);
    if (!limb.border || !data_below(along)) return point;
    point.angle_deg = limb.outer_rad * kDegreesPerRadian;
    point.position_m = limb.border->position_m;
    point.range_m = (point.position_m - from_m_).norm();
    if (const auto pixel = view_.project(from_m_ + point.range_m * along)) {
      point.x_px = pixel->x, point.y_px = pixel->y;
      const Camera& camera = view_.camera();
      point.in_frame = point.x_px >= -0.5 && point.y_px >= -0.5 && point.x_px < camera.width - 0.5 &&
                       point.y_px < camera.height - 0.5;
    }
    return point;
  }

  const dem::Terrain& terrain_;
  RenderCache& kept_;
  const StopToken& stop_;
  const RowViews views_;
  const View& view_;
  const Vec3 from_m_;
  const double distance_m_;
  const Vec3 center_;
  Vec3 right_, down_;  // unit, normal to center_
  std::vector<Limb> limbs_;
};

}  // namespace

std::vector<LimbPoint> find_limb(const LimbRequest& request, const dem::Terrain& terrain, RenderCache& kept,
                                 const StopToken& stop) {
  return LimbFinder(request, terrain, kept, stop).find();
}

}  // namespace selenograph::engine
