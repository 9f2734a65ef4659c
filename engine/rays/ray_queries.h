// Intersects arbitrary rays with the finest terrain and objects, and finds landmarks in an image: POST /v1/rays and
// POST /v1/project.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "dem/grid/geodesy.h"
#include "engine/frame/camera.h"
#include "engine/frame/objects.h"
#include "engine/frame/pose.h"
#include "engine/frame/shutter.h"
#include "engine/frame/sky.h"
#include "engine/frame/sun.h"

namespace selenograph::engine {

struct RenderContext;

// A ray of POST /v1/rays.
struct Ray {
  Vec3 origin_m;
  Vec3 direction;  // unit
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
  Vec3 position_m = Vec3::zero();
  Vec3 normal = Vec3::zero();
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

// Intersects rays with the finest terrain, rocks and objects; returns a hit for each ray. Of ground with detail,
// posts closer than `min_spacing_m` and rocks below it are left out. Throws TooMuchTerrain (an ImpossibleRequest),
// DataError and Cancelled.
std::vector<RayHit> cast_rays(std::span<const Ray> rays, const std::vector<SceneObject>& objects,
                              const std::optional<Sun>& sun, const RenderContext& context, double min_spacing_m = 0);

// Projects landmarks. in_frame: the pixel coordinates are within [-0.5, width-0.5) x [-0.5, height-0.5) and the point
// is in front of the camera; visible: in_frame and nothing stands between. With a shutter a landmark appears in the
// row that sees it, in the pose of that row's time (interpolated between rows: y_px is not rounded). If several rows
// see it, any of them is returned; if none does, the pixel coordinates are NaN. Throws as cast_rays does, and
// ImpossibleRequest for a camera below the terrain or inside an object.
std::vector<Landmark> project_landmarks(const Camera& camera, const Pose& pose, const std::optional<Shutter>& shutter,
                                        std::span<const LandmarkQuery> points, const std::vector<SceneObject>& objects,
                                        const std::optional<Sun>& sun, const RenderContext& context);

// Returns the first occluder of each ray toward a distant object: the Moon with its rocks (if `moon`), an object, or
// none. Rays that stay 13 km above the datum, or pass 12 km below it, are decided without terrain: there the Moon
// occludes even where there is no data. `detail_within_m`: farther away the ground is taken without detail, because a
// ray along the horizon would need so many blocks with detail that it takes seconds.
std::vector<HiddenBy> what_hides(std::span<const Ray> rays, const std::vector<SceneObject>& objects, bool moon,
                                 const RenderContext& context,
                                 double detail_within_m = std::numeric_limits<double>::infinity());

}  // namespace selenograph::engine
