#include "engine/camera/row_views.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "dem/base/error.h"

namespace selenograph::engine {
namespace {

// Of a line camera: its one row, on which the principal point lies.
Camera line_of(Camera camera) {
  camera.height = 1;
  camera.cy = 0;
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
  poses.reserve(static_cast<std::size_t>(height_));
  rows_.reserve(static_cast<std::size_t>(height_));
  for (int row = 0; row < height_; ++row) {
    if (row % 64 == 0) stop.check();
    poses.push_back(track_->at(shutter->time_s(row)));
    if (!(poses.back().position_m.array().abs() <= kFarthest_m).all())
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
  all.first_row = static_cast<int>(first);
  all.past_last_row = static_cast<int>(past_last);
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
  bundle(poses, first, middle);
  bundle(poses, middle, past_last);
}

View RowViews::at_row(double row) const { return reference_.at(track_->at(shutter_->time_s(row))); }

// How far below the row of a moment, in which the camera is then, a point appears; empty where it isn't imaged.
std::optional<double> RowViews::off_row_px(const Vec3& point_m, double row) const {
  const bool whole = row >= 0 && row < height_ && row == std::floor(row);
  const auto pixel = whole ? of(static_cast<int>(row)).project(point_m) : at_row(row).project(point_m);
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
    before = row;
    off_before = off;
    if (row - *off / slope == row || !std::isfinite(*off / slope)) return std::nullopt;
    row -= *off / slope;
  }
  return std::nullopt;
}

// By halves, where the point is on one side of its row above and on the other side below.
std::optional<double> RowViews::row_between(const Vec3& point_m, double above, double below,
                                            bool positive_above) const {
  for (;;) {
    const double middle = (above + below) / 2;
    if (middle == above || middle == below) return middle;
    const auto off = off_row_px(point_m, middle);
    if (!off) return std::nullopt;  // not one way through: it left what the lens images in between
    if (std::abs(*off) <= kFound_px) return middle;
    ((*off > 0) == positive_above ? above : below) = middle;
  }
}

std::optional<Sighting> RowViews::sighting(const Vec3& point_m, double row) const {
  const View view = at_row(row);
  const auto pixel = view.project(point_m);
  if (!pixel) return std::nullopt;
  return Sighting{{pixel->x, row}, shutter_->time_s(row), view.position()};
}

// A walk down the image. Between two stops at which the point is on different sides of the row that is exposed then,
// there is a time at which it is on it.
class RowViews::Search {
 public:
  // `beside`: where the point is known to be seen beside the image.
  Search(const RowViews& views, const Vec3& point_m, std::optional<Sighting> beside)
      : views_(views), point_m_(point_m), beside_(std::move(beside)), off_above_(off(above_)) {}

  // On to a row, which may be in between two. True: the point is found in the image.
  bool reach(double row) {
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
    if (in_image || !beside_) (in_image ? in_image_ : beside_) = crossing;
    return in_image;
  }

  // A row's pixels reach half a row to each side of it. A point that comes that near and turns back is on none at its
  // time, and is seen by the nearest one.
  void note_nearest(int row) {
    if (!off_above_ || std::abs(*off_above_) > least_px_) return;
    const auto here = views_.sighting(point_m_, row);
    if (!here || !views_.in_columns(here->pixel.x)) return;
    least_px_ = std::abs(*off_above_);
    nearest_ = here;
  }

  std::optional<Sighting> found() const { return in_image_ ? in_image_ : nearest_ ? nearest_ : beside_; }

 private:
  std::optional<double> off(double row) const { return views_.off_row_px(point_m_, row); }

  const RowViews& views_;
  const Vec3& point_m_;
  std::optional<Sighting> in_image_, nearest_, beside_;
  double above_ = -0.5, least_px_ = 0.5;
  std::optional<double> off_above_;
};

Vec3 RowViews::camera_seeing(const Vec3& point_m) const {
  if (!vary()) return reference_.position();
  if (const auto seen = find(point_m)) return seen->camera_m;
  const auto far_m = [&](const ViewBundle& some) { return (some.view.position() - point_m).squaredNorm(); };
  return std::min_element(bundles_.begin(), bundles_.end(),
                          [&](const ViewBundle& a, const ViewBundle& b) { return far_m(a) < far_m(b); })
      ->view.position();
}

// By secants from the middle, which is all that a slow camera needs. What that doesn't find in the image is looked for
// row by row where the point may be in the image, and in steps of bundles elsewhere.
std::optional<Sighting> RowViews::find(const Vec3& point_m) const {
  const std::optional<double> row = row_by_secant(point_m);
  const auto quick = row && in_rows(*row) ? sighting(point_m, *row) : std::nullopt;
  if (quick && in_columns(quick->pixel.x)) return quick;
  Search search(*this, point_m, quick);
  for (const ViewBundle& some : bundles_) {
    if (!some.may_see(point_m, 0)) {
      if (search.reach(some.first_row)) return search.found();
      continue;
    }
    if (search.reach(some.first_row - 1)) return search.found();
    for (int i = some.first_row; i < some.past_last_row; ++i) {
      if (search.reach(i)) return search.found();
      search.note_nearest(i);
    }
  }
  search.reach(height_ - 0.5);
  return search.found();
}

}  // namespace selenograph::engine
