#include "engine/verify/accuracy_scenes.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "dem/base/error.h"
#include "dem/grid/rotation.h"

namespace selenograph::engine {
namespace {

constexpr double kFieldOfView_deg = 50;

// Returns a camera with a square image, kFieldOfView_deg wide.
Camera square_camera(int side_px) {
  const double f = side_px / 2.0 / std::tan(kFieldOfView_deg / 2 * kRadiansPerDegree), centre = (side_px - 1) / 2.0;
  return {side_px, side_px, f, f, centre, centre, {}};
}

// A site above which cameras look at the terrain.
struct Station {
  const dem::Terrain& terrain;
  Geographic site;
  int side_px;

  // Returns a frame from a height above the ground. Throws ImpossibleRequest if the site has no terrain.
  FrameRequest frame(double height_m, double tilt_deg, double sun_azimuth_deg, double sun_elevation_deg) const {
    const double ground = terrain.height(site.lat_deg, site.lon_deg).height_m;
    if (std::isnan(ground)) throw ImpossibleRequest("no terrain where the scenes are to be seen");
    FrameRequest request;
    request.camera = square_camera(side_px);
    request.pose = tilted_pose(to_cartesian({site.lat_deg, site.lon_deg, ground + height_m}), tilt_deg);
    request.sun.direction = sun_direction(local_axes(request.pose.position_m), sun_azimuth_deg, sun_elevation_deg);
    return request;
  }
};

// Returns the angle between the nadir and the sphere's horizon.
double horizon_tilt_deg(double height_m) {
  return std::asin(kMoonRadius_m / (kMoonRadius_m + height_m)) * kDegreesPerRadian;
}

}  // namespace

Pose tilted_pose(const Vec3& position_m, double tilt_deg) {
  const EastNorthUp axes = local_axes(position_m);
  const Vec3 z = -axes.up * std::cos(tilt_deg * kRadiansPerDegree) +
                 axes.north * std::sin(tilt_deg * kRadiansPerDegree),
             x = axes.east;
  return {position_m, Quat(Mat3::from_rows(x, z.cross(x), z))};
}

std::vector<AccuracyScene> accuracy_scenes(const dem::Terrain& terrain, const Geographic& site,
                                           const std::optional<Geographic>& polar_place, int side_px, double height_m) {
  const Station station{terrain, site, side_px};
  std::vector<AccuracyScene> scenes;
  const std::string from = fmt::format("from {:g} km", height_m / 1e3);
  scenes.push_back({"nadir", "straight down " + from + ", Sun 15 degrees high", {station.frame(height_m, 0, 90, 15)}});
  scenes.push_back({"oblique",
                    "60 degrees from the nadir, " + from + ", Sun 15 degrees high",
                    {station.frame(height_m, 60, 90, 15)}});
  scenes.push_back({"limb",
                    "towards the horizon " + from + ", Sun 15 degrees high",
                    {station.frame(height_m, horizon_tilt_deg(height_m), 90, 15)}});
  if (polar_place)
    scenes.push_back({"polar",
                      "straight down " + from + " near a pole, Sun 2 degrees high",
                      {Station{terrain, *polar_place, side_px}.frame(height_m, 0, 90, 2)}});
  AccuracyScene descent{
      "descent", "straight down from 100 km, 32, 10, 3.2, 1 km, 320 and 100 m, Sun 10 degrees high", {}};
  for (int i = 0; i < 7; ++i) descent.frames.push_back(station.frame(100e3 * std::pow(10, -0.5 * i), 0, 90, 10));
  scenes.push_back(std::move(descent));
  return scenes;
}

AccuracyScene touchdown_scene(const dem::Terrain& detailed, const std::shared_ptr<const dem::Detail>& detail,
                              const Geographic& site, int side_px) {
  AccuracyScene scene{"touchdown", "straight down from 100, 30, 10 and 3 m, Sun 10 degrees high, with detail", {}};
  for (const double height_m : {100.0, 30.0, 10.0, 3.0}) {
    scene.frames.push_back(Station{detailed, site, side_px}.frame(height_m, 0, 90, 10));
    scene.frames.back().detail = detail;
  }
  return scene;
}

}  // namespace selenograph::engine
