// Who sees each row of a frame: one view all of them or, where rows are exposed one after the other, each its own.
#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "dem/support/stop_token.h"
#include "engine/camera/pose_track.h"
#include "engine/camera/view.h"
#include "engine/frame/shutter.h"

namespace selenograph::engine {

// The views of some rows: one of them, and how far the others are from it at most. What it answers holds for all.
//
// In camera axes a point is, from the others, at most slack_m elsewhere: they are moved by up to shift_m and turned by
// up to turn_rad. A ball that is larger by that encloses what the others see of it.
struct ViewBundle {
  View view;
  double shift_m = 0, turn_rad = 0;
  int first_row = 0, past_last_row = 0;  // of a frame whose rows vary

  // As View has them: upper bounds over all views.
  bool may_see(const Vec3& centre_m, double radius_m) const;
  bool may_see(std::span<const Vec3> points_m, double margin_m) const;
  double pixels_per_metre(const Vec3& centre_m, double radius_m,
                          double highest_m = std::numeric_limits<double>::infinity()) const;
  double pixels_per_metre_from(double nearest_m) const { return view.pixels_per_metre_from(nearest_m - shift_m); }

 private:
  double slack_m(const Vec3& point_m) const;
};

// Where a point appears in a frame whose rows are exposed one after the other.
struct Sighting {
  PixelXY pixel;  // of the frame; y is the row, not rounded
  double time_s;  // from the exposure of row 0
  Vec3 camera_m;  // where the camera is then
};

class RowViews {
 public:
  // Throws ImpossibleRequest for a camera or pose that can't be, Cancelled when `stop` says so.
  RowViews(const Camera& camera, const Pose& pose, const std::optional<Shutter>& shutter, const StopToken& stop = {});

  // Whether each row has a view of its own.
  bool vary() const { return !rows_.empty(); }
  const View& of(int row) const { return rows_.empty() ? reference_ : rows_[static_cast<std::size_t>(row)]; }
  const View& of_pixel(std::size_t pixel) const { return rows_.empty() ? reference_ : rows_[pixel / width_]; }
  // The one view, or that of the row in the middle.
  const View& reference() const { return reference_; }

  int height() const { return height_; }  // of the frame
  // Of all views: the frame's, but of a line camera, whose image is a single line on the row of the principal point.
  const Camera& camera() const { return reference_.camera(); }
  // The row of that camera which a row of the frame is.
  int line(int row) const { return pushbroom_ ? 0 : row; }

  // Together they bound the views of all rows; neither empty nor many.
  std::span<const ViewBundle> bundles() const { return bundles_; }

  // Where rows vary: one of the places where a point appears, in the row of that time; in the image, wherever any row
  // sees it there (a turning camera's rows may see it several times), else beside it in x. Empty where no row sees it:
  // beside the image in y. Costs a projection for each row, at most.
  std::optional<Sighting> find(const Vec3& point_m) const;

 private:
  class Search;
  View at_row(double row) const;
  void bundle(const std::vector<Pose>& poses, std::size_t first, std::size_t past_last);
  std::optional<double> off_row_px(const Vec3& point_m, double row) const;
  std::optional<double> row_by_secant(const Vec3& point_m) const;
  std::optional<double> row_between(const Vec3& point_m, double above, double below, bool positive_above) const;
  bool in_columns(double x_px) const { return x_px >= -0.5 && x_px < static_cast<double>(width_) - 0.5; }
  bool in_rows(double row) const { return row >= -0.5 && row < height_ - 0.5; }
  std::optional<Sighting> sighting(const Vec3& point_m, double row) const;

  std::size_t width_;
  int height_;
  bool pushbroom_ = false;
  View reference_;
  std::optional<Shutter> shutter_;
  std::optional<PoseTrack> track_;
  std::vector<View> rows_;
  std::vector<ViewBundle> bundles_;
};

}  // namespace selenograph::engine
