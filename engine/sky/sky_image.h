// Stars and planets in one exposure sample of a frame.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "engine/sensor/sensor.h"
#include "engine/sky/sky_in_view.h"

namespace selenograph::engine {

// The visible stars and planets as points of the image.
//
// If rows have views of their own, a point is recorded once for each row that images it, at that row's position: a line
// camera that turns by less than a pixel per row images a point in several rows.
class SkyImage {
 public:
  // `request`: its camera includes the margin, its pose is that of the exposure sample. The image is empty without a
  // sky. `spread_px`: radius of the sensor's point spread. `range_m`: range of every pixel, if wants_ranges_for_sky.
  // Throws as sky_around and find_hidden do.
  SkyImage(const FrameRequest& request, int spread_px, std::span<const double> range_m, const RenderContext& context);

  // Adds each point's irradiance, divided by the solid angle of a pixel, to the frame's radiance, W m-2 sr-1, as a
  // square of one pixel (add_square).
  void add_to(std::vector<float>& radiance) const;
  // Visits all points in batches, in coordinates of a sensor's image, which lacks the margin.
  void for_points(int margin_px, const std::function<void(std::span<const LightPoint>)>& visit) const;

 private:
  struct Source {
    Vec3 direction;
    double radiance_w_m2_sr, counted_w_m2_sr;  // 0: occluded, or not imaged by the lens
  };
  struct ImagePoint {
    double x_px, y_px;
    std::int32_t row;      // the only row that images the point; kAllRows: all rows do
    std::uint32_t source;  // index into sources_
  };
  static constexpr std::int32_t kAllRows = -1;
  std::vector<ImagePoint> image_points_of(const SkyObject& object, double reach_px) const;
  void locate(const FrameRequest& request, double reach_px, std::vector<SkyObject>& sky, const StopToken& stop);

  Camera camera_;
  std::optional<RowViews> views_;
  std::vector<Source> sources_;
  std::vector<ImagePoint> image_points_;
};

}  // namespace selenograph::engine
