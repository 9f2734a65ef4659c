#include "engine/camera/row_views.h"

#include <algorithm>
#include <cmath>

#include "dem/error.h"

namespace selenograph::engine {
namespace {

// Of a line camera: its one row, on which the principal point lies.
Camera line_of(Camera camera) {
  camera.height = 1, camera.cy = 0;
  return camera;
}

// Beyond all poses that a request can give.
constexpr double kFarthest_m = 2e12;

double turn_between(const Pose& a, const Pose& b) {
  if (a.camera_from_moon.coeffs() == b.camera_from_moon.coeffs()) return 0;
  return a.camera_from_moon.angularDistance(b.camera_from_moon);
}

}  // namespace

// The other camera's coordinates of a point are, by a turn Q and a shift s, Q (c + s): with |Q - 1| at most the angle,
// |Q (c + s) - c| is at most |s| + angle (|c| + |s|).
double ViewBundle::slack_m(const Vec3& point_m) const {
  return shift_m + turn_rad * ((point_m - view.position()).norm() + shift_m);
}

bool ViewBundle::may_see(const Vec3& centre_m, double radius_m) const {
  return view.may_see(centre_m, radius_m + slack_m(centre_m));
}

bool ViewBundle::may_see(std::span<const Vec3> points_m, double margin_m) const {
  double slack = 0;
  for (const Vec3& point : points_m) slack = std::max(slack, slack_m(point));
  return view.may_see(points_m, margin_m + slack);
}

double ViewBundle::pixels_per_metre(const Vec3& centre_m, double radius_m, double highest_m) const {
  return view.pixels_per_metre(centre_m, radius_m + slack_m(centre_m), highest_m + shift_m);
}

RowViews::RowViews(const Camera& camera, const Pose& pose, const std::optional<Shutter>& shutter, const StopToken& stop)
    : width_(static_cast<std::size_t>(std::max(camera.width, 0))),
      height_(camera.height),
      pushbroom_(shutter && shutter->pushbroom),
      reference_(pushbroom_ && camera.height > 0 ? line_of(camera) : camera, pose),
      shutter_(shutter) {
  if (!shutter) {
    bundles_ = {{reference_}};
    return;
  }
  track_.emplace(pose, *shutter);
  std::vector<Pose> poses;
  poses.reserve(static_cast<std::size_t>(height_)), rows_.reserve(static_cast<std::size_t>(height_));
  for (int row = 0; row < height_; ++row) {
    if (row % 64 == 0) stop.check();
    poses.push_back(track_->at(shutter->time_s(row)));
    if (!(poses.back().position_m.cwiseAbs().maxCoeff() <= kFarthest_m))
      throw ImpossibleRequest("the camera moves more than 2e12 m from the Moon's centre", "shutter");
    rows_.push_back(reference_.at(poses.back()));
  }
  reference_ = rows_[rows_.size() / 2];
  bundle(poses, 0, rows_.size());
}

// Rows whose views differ by little are bounded together: by half as many while they differ by more, down to the few
// hundred bundles that a selection can ask one by one.
void RowViews::bundle(const std::vector<Pose>& poses, std::size_t first, std::size_t past_last) {
  constexpr double kLittle_px = 8, kNear_m = 100;
  const std::size_t middle = (first + past_last) / 2, fewest = rows_.size() / 256 + 1;
  ViewBundle all{rows_[middle]};
  for (std::size_t i = first; i < past_last; ++i) {
    all.shift_m = std::max(all.shift_m, (poses[i].position_m - poses[middle].position_m).norm());
    all.turn_rad = std::max(all.turn_rad, turn_between(poses[i], poses[middle]));
  }
  const double height_m = std::max(poses[middle].position_m.norm() - kMoonRadius_m, kNear_m);
  const double apart_px = std::max(camera().fx, camera().fy) * (all.shift_m / height_m + all.turn_rad);
  if (apart_px <= kLittle_px || past_last - first <= fewest) {
    bundles_.push_back(all);
    return;
  }
  bundle(poses, first, middle), bundle(poses, middle, past_last);
}

View RowViews::at_row(double row) const { return reference_.at(track_->at(shutter_->time_s(row))); }

// How far below the row of a moment, in which the camera is then, a point appears; empty where it isn't imaged.
std::optional<double> RowViews::off_row_px(const Vec3& point_m, double row) const {
  const auto pixel = at_row(row).project(point_m);
  if (!pixel) return std::nullopt;
  return pixel->y - (pushbroom_ ? 0 : row);
}

namespace {
// Of rows: a thousandth of what is promised, well above the rounding of a projection.
constexpr double kFound_px = 1e-7;
}  // namespace

// From the middle. Empty where it leads nowhere, or out of the image.
std::optional<double> RowViews::row_by_secant(const Vec3& point_m) const {
  constexpr int kMostSteps = 20;
  double before = (height_ - 1) / 2.0, row = before + 1;
  std::optional<double> off_before = off_row_px(point_m, before);
  // A rolling shutter moves little while a row is read: the row where the point was is a first guess.
  if (off_before && !pushbroom_) row = before + *off_before;
  for (int step = 0; step < kMostSteps && off_before; ++step) {
    const auto off = std::abs(row) <= 4.0 * (height_ + 1) ? off_row_px(point_m, row) : std::nullopt;
    if (!off) return std::nullopt;
    if (std::abs(*off) <= kFound_px) return row;
    const double slope = (*off - *off_before) / (row - before);
    before = row, off_before = off;
    if (row - *off / slope == row || !std::isfinite(*off / slope)) return std::nullopt;
    row -= *off / slope;
  }
  return std::nullopt;
}

// The first change of sign among places all over the image, and from there by halves.
std::optional<double> RowViews::row_by_search(const Vec3& point_m) const {
  constexpr int kPlaces = 64;
  const double top = -0.5, bottom = height_ - 0.5;
  double above = top;
  std::optional<double> off_above = off_row_px(point_m, above);
  for (int i = 1; i <= kPlaces; ++i) {
    double below = top + (bottom - top) * i / kPlaces;
    const auto off_below = off_row_px(point_m, below);
    if (off_above && off_below && (*off_above > 0) != (*off_below > 0)) {
      const bool positive_above = *off_above > 0;
      for (;;) {
        const double middle = (above + below) / 2;
        if (middle == above || middle == below) return middle;
        const auto off = off_row_px(point_m, middle);
        if (!off) return std::nullopt;  // not one way through: it left what the lens images in between
        if (std::abs(*off) <= kFound_px) return middle;
        ((*off > 0) == positive_above ? above : below) = middle;
      }
    }
    above = below, off_above = off_below;
  }
  return std::nullopt;
}

std::optional<Sighting> RowViews::find(const Vec3& point_m) const {
  const auto in_image = [&](double row) { return row >= -0.5 && row < height_ - 0.5; };
  std::optional<double> row = row_by_secant(point_m);
  if (!row || !in_image(*row)) row = row_by_search(point_m);
  if (!row || !in_image(*row)) return std::nullopt;
  const View view = at_row(*row);
  const auto pixel = view.project(point_m);
  if (!pixel) return std::nullopt;
  return Sighting{{pixel->x, *row}, shutter_->time_s(*row), view.position()};
}

}  // namespace selenograph::engine
