// What a moment of a frame shows of the sky.
#pragma once

#include <vector>

#include "engine/sensor/sensor.h"
#include "engine/sky_in_view.h"

namespace selenograph::engine {

// Stars and planets that nothing hides, as points.
class SkyImage {
 public:
  // `request`: its camera has the margin, and its pose is that of the moment. Empty unless it asks for a sky.
  // `spread_px`: how far a sensor spreads a point. Throws as sky_around and find_hidden do.
  SkyImage(const FrameRequest& request, int spread_px, const dem::Terrain& terrain, RenderCache& kept,
           const StopToken& stop);

  // Adds each point's irradiance over the solid angle of a pixel to the frame's radiance, W m-2 sr-1, as the square of
  // a pixel (add_square). Where rows have views of their own, each one of them has its part of the square where it sees
  // the point: a line camera that turns by less than a pixel a row sees it in several.
  void add_to(std::vector<float>& radiance) const;
  // For a sensor, whose image lacks the margin.
  std::vector<LightPoint> points(int margin_px) const;

 private:
  struct Point {
    LightPoint light;
    double radiance_w_m2_sr;
  };
  Camera camera_;
  std::vector<Point> points_;
};

}  // namespace selenograph::engine
