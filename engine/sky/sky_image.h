// The sky in one moment of a frame.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "engine/sensor/sensor.h"
#include "engine/sky/sky_in_view.h"

namespace selenograph::engine {

// Stars and planets that nothing hides, as points.
//
// Where rows have views of their own, each one of them sees its part of a point, where it has it: a line camera that
// turns by less than a pixel a row sees a point in several.
class SkyImage {
 public:
  // `request`: its camera has the margin, and its pose is that of the moment. Empty unless it asks for a sky.
  // `spread_px`: how far a sensor spreads a point. `range_m`: of every pixel, if wants_ranges_for_sky. Throws as
  // sky_around and find_hidden do.
  SkyImage(const FrameRequest& request, int spread_px, std::span<const double> range_m, const dem::Terrain& terrain,
           RenderCache& kept, const StopToken& stop);

  // Adds each point's irradiance over the solid angle of a pixel to the frame's radiance, W m-2 sr-1, as the square of
  // a pixel (add_square).
  void add_to(std::vector<float>& radiance) const;
  // For a sensor, whose image lacks the margin: all points, some at a time.
  void for_points(int margin_px, const std::function<void(std::span<const LightPoint>)>& visit) const;

 private:
  struct Source {
    Vec3 direction;
    double radiance_w_m2_sr, counted_w_m2_sr;  // 0: something hides it, or the lens images nothing there
  };
  struct Place {
    double x_px, y_px;
    std::int32_t row;  // that has it, alone; kAllRows
    std::uint32_t source;
  };
  static constexpr std::int32_t kAllRows = -1;
  std::vector<Place> places_of(const SkyObject& object, double reach_px) const;
  void find(const FrameRequest& request, double reach_px, std::vector<SkyObject>& sky, const StopToken& stop);

  Camera camera_;
  std::optional<RowViews> views_;
  std::vector<Source> sources_;
  std::vector<Place> places_;
};

}  // namespace selenograph::engine
