// Views of a frame's rows: one view for all rows or, when rows are exposed one after the other, one per row.
#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "dem/base/stop_token.h"
#include "engine/camera/pose_track.h"
#include "engine/camera/view.h"
#include "engine/frame/shutter.h"

namespace selenograph::engine {

// The views of several rows: one view, and upper bounds of the deviations of the others. Its answers hold for all of
// them.
//
// The other views are shifted by up to shift_m and rotated by up to turn_rad, so in camera axes a point moves by at
// most slack_m(). A sphere enlarged by that contains the sphere in all views.
struct ViewBundle {
  View view;
  double shift_m = 0, turn_rad = 0;
  int first_row = 0, past_last_row = 0;  // range of rows, if rows have their own views

  // Upper bounds over all views, as in View.
  bool may_see(const Vec3& centre_m, double radius_m) const;
  bool may_see(std::span<const Vec3> points_m, double margin_m) const;
  double pixels_per_metre(const Vec3& centre_m, double radius_m,
                          double highest_m = std::numeric_limits<double>::infinity()) const;
  double pixels_per_metre_from(double nearest_m) const { return view.pixels_per_metre_from(nearest_m - shift_m); }

 private:
  // Upper bound of a point's movement in camera axes between the views, m.
  double slack_m(const Vec3& point_m) const;
};

// Returns the camera of a pushbroom's rows: one row, at Shutter::line_px below the principal point.
Camera line_camera(Camera camera, const Shutter& shutter);

// Image position of a point in a frame whose rows are exposed one after the other.
struct Sighting {
  PixelXY pixel;  // position in the frame; y is the row, not rounded
  double time_s;  // seconds from the exposure of row 0
  Vec3 camera_m;  // camera position at that time
};

class RowViews {
 public:
  // Throws ImpossibleRequest for an invalid camera or pose, Cancelled once `stop` is requested.
  RowViews(const Camera& camera, const Pose& pose, const std::optional<Shutter>& shutter, const StopToken& stop = {});

  // Returns true if each row has its own view.
  bool vary() const { return !rows_.empty(); }
  const View& of(int row) const { return rows_.empty() ? reference_ : rows_[static_cast<std::size_t>(row)]; }
  const View& of_pixel(std::size_t pixel) const { return rows_.empty() ? reference_ : rows_[pixel / width_]; }
  // Returns the only view, or that of the middle row.
  const View& reference() const { return reference_; }

  // Returns the camera's position when it images a point; for a point that no row images, the position nearest to it.
  Vec3 camera_seeing(const Vec3& point_m) const;

  int height() const { return height_; }  // rows of the frame
  // Returns true if every row is imaged by the same row of the camera.
  bool pushbroom() const { return pushbroom_; }
  // Upper bounds of the camera's movement from one row to the next, in its own axes: along the boresight and about it,
  // and across.
  struct Step {
    double shift_along_m = 0, shift_across_m = 0, turn_along_rad = 0, turn_across_rad = 0;
    // Returns an upper bound of the image's movement, in focal lengths, at a depth and at a slope sqrt(x^2 + y^2) / z.
    double image_shift(double depth_m, double slope) const {
      return (shift_across_m + slope * shift_along_m) / depth_m + slope * turn_along_rad +
             (1 + slope * slope) * turn_across_rad;
    }
  };
  const Step& max_step() const { return max_step_; }
  // Returns the camera of all views: the frame's camera or, for a pushbroom, its line_camera().
  const Camera& camera() const { return reference_.camera(); }
  // Returns the row of camera() for a row of the frame.
  int line(int row) const { return pushbroom_ ? 0 : row; }

  // Returns bundles that bound the views of all rows: at least one, at most a few hundred.
  std::span<const ViewBundle> bundles() const { return bundles_; }

  // Finds a point's image position in the row exposed at that time, for rows with their own views. It is inside the
  // image if any row images it there (a turning camera may image it in several rows), otherwise left or right of it.
  // Empty if no row images the point. Costs at most one projection per row.
  std::optional<Sighting> find(const Vec3& point_m) const;

 private:
  class Search;
  View at_row(double row) const;
  void extend_max_step(const Pose& from, const Pose& to);
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
  Step max_step_;
};

}  // namespace selenograph::engine
