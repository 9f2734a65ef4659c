// Rays and landmarks: POST /v1/rays and POST /v1/project.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

// A ray of POST /v1/rays.
struct Ray {
  Vec3 origin_m;
  Vec3 direction;  // unit
};

// Rays that begin within `radius_m` of a position and lie within an angle of a direction: a single ray, or a bundle.
struct RayCone {
  Vec3 origin_m;
  Vec3 direction;  // unit
  double radius_m = 0;
  double slope = 0;                                       // tangent of the angle
  double to_m = std::numeric_limits<double>::infinity();  // limit along the axis: hits beyond it do not count
  bool is_single_ray() const { return radius_m == 0 && slope == 0; }
};

// Irradiance of a surface: from the Sun directly, reflected by terrain, from the Earth.
struct Irradiance {
  double direct_w_m2 = 0, terrain_w_m2 = 0, earth_w_m2 = 0;
};

// A point on a surface whose light is requested.
struct LitPlace {
  Vec3 position_m, normal;
  double incident;  // visible share of the Sun's disc times its mean cosine of incidence
};

struct RayHit {
  bool hit = false;
  std::optional<std::uint16_t> object{};  // index into the query's objects; empty: terrain or a rock
  double range_m = std::numeric_limits<double>::quiet_NaN();
  Vec3 position_m = Vec3::Zero();
  Vec3 normal = Vec3::Zero();
  double lit = 0;                       // visible share of the Sun's disc; valid with a Sun
  std::optional<std::uint64_t> rock{};  // dem::Rock::id
  double incident = 0;                  // `lit` times the sunlight's mean cosine of incidence
};

// A point of POST /v1/project.
struct LandmarkQuery {
  double lat_deg = 0, lon_deg = 0;
  std::optional<double> height_m;  // empty: on the terrain
};

struct Landmark {
  double x_px = 0, y_px = 0;  // NaN behind the camera and where the lens images nothing
  double range_m = 0;
  double height_m = 0;  // NaN: no data
  bool in_frame = false, visible = false;
  double lit = std::numeric_limits<double>::quiet_NaN();  // NaN without height or Sun
  // For rows exposed one after the other: time of the row that images the point, seconds from the exposure of row 0.
  // NaN, like x_px, y_px and range_m, if no row images it.
  double time_s = std::numeric_limits<double>::quiet_NaN();
  bool behind_camera = false;       // only for a pinhole whose rows are exposed at once
  std::optional<LitPlace> place{};  // on terrain, with a Sun
};

}  // namespace selenograph::engine
