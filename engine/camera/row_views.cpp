#include "engine/camera/row_views.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "dem/base/error.h"

namespace selenograph::engine {
namespace {

// Limit of the distance from the Moon's centre, farther than any pose of a request.
constexpr double kFarthest_m = 2e12;

double turn_between(const Pose& a, const Pose& b) {
  if (a.camera_from_moon == b.camera_from_moon) return 0;
  return a.camera_from_moon.angle_to(b.camera_from_moon);
}

}  // namespace

Camera line_camera(Camera camera, const Shutter& shutter) {
  camera.height = 1;
  camera.cy = -shutter.line_px;
  return camera;
}

// With a turn Q and a shift s, another camera's coordinates of a point c are Q (c + s). As |Q - 1| is at most the
// angle, |Q (c + s) - c| is at most |s| + angle (|c| + |s|).
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
      reference_(pushbroom_ && camera.height > 0 ? line_camera(camera, *shutter) : camera, pose),
      shutter_(shutter) {
  if (!shutter) {
    bundles_ = {{reference_}};
    return;
  }
  track_.emplace(pose, *shutter);
  std::vector<Pose> poses;
  poses.reserve(static_cast<std::size_t>(height_));
  rows_.reserve(static_cast<std::size_t>(height_));
  for (int row = 0; row < height_; ++row) {
    if (row % 64 == 0) stop.check();
    poses.push_back(track_->at(shutter->time_s(row)));
    if (!poses.back().position_m.is_within(kFarthest_m))
      throw ImpossibleRequest("the camera moves more than 2e12 m from the Moon's centre", "shutter");
    rows_.push_back(reference_.at(poses.back()));
    if (row > 0) extend_max_step(poses[poses.size() - 2], poses.back());
  }
  reference_ = rows_[rows_.size() / 2];
  bundle(poses, 0, rows_.size());
}

// Extends the bounds of a step to that between two poses. Twice the vector part of the quaternion between them is the
// turn about each axis, up to a cubic term.
void RowViews::extend_max_step(const Pose& from, const Pose& to) {
  const Vec3 shift_m = from.camera_from_moon * (to.position_m - from.position_m);
  const Vec3 turn_rad = 2 * (to.camera_from_moon * from.camera_from_moon.conjugate()).vec();
  const auto across = [](const Vec3& v) { return std::hypot(v.x(), v.y()); };
  max_step_.shift_along_m = std::max(max_step_.shift_along_m, std::abs(shift_m.z()));
  max_step_.shift_across_m = std::max(max_step_.shift_across_m, across(shift_m));
  max_step_.turn_along_rad = std::max(max_step_.turn_along_rad, std::abs(turn_rad.z()));
  max_step_.turn_across_rad = std::max(max_step_.turn_across_rad, across(turn_rad));
}

// Bundles the rows from first to past_last if their views differ by at most kMaxDifference_px at the ground. Otherwise
// halves the range, down to 1/256 of the rows, so that a selection can test the bundles one by one.
void RowViews::bundle(const std::vector<Pose>& poses, std::size_t first, std::size_t past_last) {
  constexpr double kMaxDifference_px = 8, kNear_m = 100;
  const std::size_t middle = (first + past_last) / 2, min_rows = rows_.size() / 256 + 1;
  ViewBundle range{rows_[middle]};
  range.first_row = static_cast<int>(first);
  range.past_last_row = static_cast<int>(past_last);
  for (std::size_t i = first; i < past_last; ++i) {
    range.shift_m = std::max(range.shift_m, (poses[i].position_m - poses[middle].position_m).norm());
    range.turn_rad = std::max(range.turn_rad, turn_between(poses[i], poses[middle]));
  }
  const double height_m = std::max(poses[middle].position_m.norm() - kMoonRadius_m, kNear_m);
  const double difference_px = std::max(camera().fx, camera().fy) * (range.shift_m / height_m + range.turn_rad);
  if (difference_px <= kMaxDifference_px || past_last - first <= min_rows) {
    bundles_.push_back(range);
    return;
  }
  bundle(poses, first, middle);
  bundle(poses, middle, past_last);
}

View RowViews::at_row(double row) const { return reference_.at(track_->at(shutter_->time_s(row))); }

// Returns a point's distance below the row that is exposed at the time of `row`, pixels; empty if the camera of that
// time does not image it.
std::optional<double> RowViews::off_row_px(const Vec3& point_m, double row) const {
  const bool is_full_row = row >= 0 && row < height_ && row == std::floor(row);
  const auto pixel = is_full_row ? of(static_cast<int>(row)).project(point_m) : at_row(row).project(point_m);
  if (!pixel) return std::nullopt;
  return pixel->y - (pushbroom_ ? 0 : row);
}

namespace {
// Tolerance of a row: a thousandth of the promised accuracy, far above the rounding of a projection.
constexpr double kTolerance_px = 1e-7;
}  // namespace

// Finds a row by the secant method from the middle row. Empty if it does not converge or leaves the image.
std::optional<double> RowViews::row_by_secant(const Vec3& point_m) const {
  constexpr int kMaxSteps = 20;
  double previous = (height_ - 1) / 2.0, row = previous + 1;
  std::optional<double> previous_off_px = off_row_px(point_m, previous);
  // A rolling shutter moves little during a row's readout: the row that images the point is a first guess.
  if (previous_off_px && !pushbroom_) row = previous + *previous_off_px;
  for (int step = 0; step < kMaxSteps && previous_off_px; ++step) {
    const auto off_px = std::abs(row) <= 4.0 * (height_ + 1) ? off_row_px(point_m, row) : std::nullopt;
    if (!off_px) return std::nullopt;
    if (std::abs(*off_px) <= kTolerance_px) return row;
    const double slope = (*off_px - *previous_off_px) / (row - previous);
    previous = row;
    previous_off_px = off_px;
    if (row - *off_px / slope == row || !std::isfinite(*off_px / slope)) return std::nullopt;
    row -= *off_px / slope;
  }
  return std::nullopt;
}

// Finds a row by bisection between two rows at which the point is on different sides.
std::optional<double> RowViews::row_between(const Vec3& point_m, double above, double below,
                                            bool positive_above) const {
  for (;;) {
    const double middle = (above + below) / 2;
    if (middle == above || middle == below) return middle;
    const auto off_px = off_row_px(point_m, middle);
    if (!off_px) return std::nullopt;  // the point leaves the lens's field of view in between
    if (std::abs(*off_px) <= kTolerance_px) return middle;
    ((*off_px > 0) == positive_above ? above : below) = middle;
  }
}

std::optional<Sighting> RowViews::sighting(const Vec3& point_m, double row) const {
  const View view = at_row(row);
  const auto pixel = view.project(point_m);
  if (!pixel) return std::nullopt;
  return Sighting{{pixel->x, row}, shutter_->time_s(row), view.position()};
}

// Search for a point down the image, in stops at rows. At the time of each stop, the point is off the row then exposed
// by off_row_px(). If the sign of that differs at two stops, some row in between images the point.
class RowViews::Search {
 public:
  // `outside`: a sighting outside the image's columns, if there is one.
  Search(const RowViews& views, const Vec3& point_m, std::optional<Sighting> outside)
      : views_(views), point_m_(point_m), outside_(std::move(outside)), off_above_(off(above_)) {}

  // Advances to a row, which may be fractional. Returns true if the point was found in the image.
  bool advance(double row) {
    if (row <= above_) return false;
    const std::optional<double> off_here = off(row);
    std::optional<Sighting> crossing;
    if (off_above_ && off_here && (*off_above_ > 0) != (*off_here > 0))
      if (const auto found = views_.row_between(point_m_, above_, row, *off_above_ > 0))
        crossing = views_.sighting(point_m_, *found);
    above_ = row;
    off_above_ = off_here;
    if (!crossing || !views_.in_rows(crossing->pixel.y)) return false;
    const bool in_image = views_.in_columns(crossing->pixel.x);
    if (in_image || !outside_) (in_image ? in_image_ : outside_) = crossing;
    return in_image;
  }

  // A row's pixels extend half a row to each side. A point that comes that near and turns back crosses no row; the
  // nearest row images it.
  void record_nearest(int row) {
    if (!off_above_ || std::abs(*off_above_) > min_distance_px_) return;
    const auto here = views_.sighting(point_m_, row);
    if (!here || !views_.in_columns(here->pixel.x)) return;
    min_distance_px_ = std::abs(*off_above_);
    nearest_ = here;
  }

  std::optional<Sighting> found() const { return in_image_ ? in_image_ : nearest_ ? nearest_ : outside_; }

 private:
  std::optional<double> off(double row) const { return views_.off_row_px(point_m_, row); }

  const RowViews& views_;
  const Vec3& point_m_;
  std::optional<Sighting> in_image_, nearest_, outside_;
  double above_ = -0.5, min_distance_px_ = 0.5;
  std::optional<double> off_above_;
};

// Returns the camera's position when it images the point or, if it never does, that of the nearest bundle.
Vec3 RowViews::camera_seeing(const Vec3& point_m) const {
  if (!vary()) return reference_.position();
  if (const auto sighted = find(point_m)) return sighted->camera_m;
  const auto squared_distance = [&](const ViewBundle& bundle) {
    return (bundle.view.position() - point_m).squared_norm();
  };
  return std::min_element(
             bundles_.begin(), bundles_.end(),
             [&](const ViewBundle& a, const ViewBundle& b) { return squared_distance(a) < squared_distance(b); })
      ->view.position();
}

// Try the secant method first, which suffices for a slow camera. Otherwise search row by row in bundles that may image
// the point, and in steps of bundles elsewhere.
std::optional<Sighting> RowViews::find(const Vec3& point_m) const {
  const std::optional<double> row = row_by_secant(point_m);
  const auto by_secant = row && in_rows(*row) ? sighting(point_m, *row) : std::nullopt;
  if (by_secant && in_columns(by_secant->pixel.x)) return by_secant;
  Search search(*this, point_m, by_secant);
  for (const ViewBundle& bundle : bundles_) {
    if (!bundle.may_see(point_m, 0)) {
      if (search.advance(bundle.first_row)) return search.found();
      continue;
    }
    if (search.advance(bundle.first_row - 1)) return search.found();
    for (int i = bundle.first_row; i < bundle.past_last_row; ++i) {
      if (search.advance(i)) return search.found();
      search.record_nearest(i);
    }
  }
  search.advance(height_ - 0.5);
  return search.found();
}

}  // namespace selenograph::engine
