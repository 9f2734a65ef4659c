// Objects over the terrain, or alone: their visibility, shadows and radiance for packets of pixels.
//
// Rays are transformed to an object's own coordinates in double and start on its bounding sphere; there float finds the
// triangle and double the point. Accuracy therefore does not depend on an object's position: in lunar orbit, on the
// ground, or next to the Earth.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "dem/detail/rocks_on_ground.h"
#include "engine/camera/row_views.h"
#include "engine/frame/request.h"
#include "engine/indirect/terrain_light.h"
#include "engine/radiometry/brdf.h"
#include "engine/scene/selection.h"
#include "engine/support/packet.h"
#include "engine/visibility/embree/object_group.h"
#include "engine/visibility/objects/ellipsoid_images.h"

namespace selenograph::engine {

inline constexpr std::uint16_t kNoObject = 65535;

// Object hits of sixteen pixels.
struct ObjectLanes {
  // As for terrain, except `triangle`; never on a triangle's edge. The facet's normal is a unit vector and faces the
  // camera.
  SurfacePoints points;
  Shading shading;
  std::uint16_t object[kPacket];  // index into FrameRequest::objects, then into the rocks; or kNoObject
  std::uint32_t part[kPacket];
  // Whether a lane that hit a rock sees not the rock itself but the soil against it: it is ground.
  bool on_soil[kPacket];
};

std::vector<Ball> balls_around(const std::vector<SceneObject>& objects);
// Whether any object's material emits.
bool objects_emit(const std::vector<SceneObject>& objects);

class ObjectsInFrame {
 public:
  // `request` must outlive this object. Rocks and the soil against them have the terrain's material. Soil is shown from
  // a height of max_error_px / 2 pixels on, and against the largest kMaxRocksWithSoil rocks only (frame/needs.h).
  ObjectsInFrame(const FrameRequest& request, const RowViews& views, std::span<const dem::RockFeature> rocks = {},
                 const StopToken& stop = {});
  // For rays with arbitrary origins; its radiances are not those of a camera.
  explicit ObjectsInFrame(const FrameRequest& request, std::span<const dem::RockFeature> rocks = {},
                          const StopToken& stop = {});
  ObjectsInFrame(const ObjectsInFrame&) = delete;
  ObjectsInFrame& operator=(const ObjectsInFrame&) = delete;

  bool empty() const { return placed_.empty(); }
  std::vector<Ball> balls_around_rocks() const;  // in view or not
  // Index of a rock from an index in ObjectLanes, if it is a rock; and the other way round.
  std::optional<std::size_t> rock(std::uint16_t object) const {
    return is_rock(object) ? std::optional<std::size_t>(object - first_rock_) : std::nullopt;
  }
  std::uint16_t index_of_rock(std::size_t rock) const { return static_cast<std::uint16_t>(first_rock_ + rock); }

  // Finds lanes where an object is nearer than the terrain, one bit each, and removes them from the terrain's points
  // and rays: no longer hit or valid, but the numbers stay. `from_camera`: whether the rays are the camera's; others
  // may meet objects that it doesn't see.
  std::uint32_t meet(Rays& rays, SurfacePoints& terrain, ObjectLanes& out, bool from_camera = true) const;

  // Lanes, of those asking, from whose points an object blocks the direction toward the Sun, one bit each. `own`: the
  // objects that the points are on; null: on terrain.
  std::uint32_t blocked(const SurfacePoints& points, const std::uint16_t* own, std::uint32_t asking,
                        const Vec3& sun) const;

  // Radiance per lane, W m-2 sr-1: with the Sun, and without it. `indirect`: may be null.
  void radiances(const ObjectLanes& lanes, const Rays& rays, const float* lit, const TerrainLight* indirect, float* out,
                 float* base) const;
  // Per lane, sr-1: mu0 f_r for light that comes from where the ray does.
  void reflected_back(const ObjectLanes& lanes, double* out) const;

 private:
  // `views` null: all objects may be seen, by rays without a common origin.
  ObjectsInFrame(const FrameRequest& request, const RowViews* views);

  struct Finish {
    Brdf brdf;
    double direct_w_m2;
    float base;
  };
  struct Placed {
    const ObjectMesh* mesh;
    Eigen::Matrix3d object_from_moon, normals;  // of vectors; of normals from the object's, whose length they change
    Vec3 position, middle;                      // MOON_ME, m; middle: origin of the tracer's rays
    double scale;
    Ball ball;
    bool in_view;
    std::uint16_t number;  // ObjectLanes::object
    bool soil;
    const std::vector<Finish>* finishes;  // per part
    Vec3 inside(const Vec3& place) const { return object_from_moon * (place - position); }
    Vec3 from_middle(const Vec3& place) const { return object_from_moon * (place - middle); }
  };

  // Of the object's coordinates; `scale`: the largest of a length.
  Placed placed(const ObjectMesh& mesh, const Vec3& position_m, const Eigen::Matrix3d& moon_from_object,
                const Eigen::Matrix3d& object_from_moon, double scale) const;
  std::vector<Finish> finishes_of(const std::vector<Material>& materials) const;
  // `views` null: soil against all of them; else where it is high enough in the image.
  void place(std::span<const dem::RockFeature> rocks, const Vec3& anchor_m, const RowViews* views,
             const StopToken& stop);
  void group(const Vec3& anchor_m, const StopToken& stop);
  void look_at_rocks(const Rays& rays, bool from_camera, double* nearest, ObjectLanes& out) const;
  std::uint32_t blocked_by_rocks(const SurfacePoints& points, const std::uint16_t* own, std::uint32_t asking,
                                 const Vec3& sun) const;
  bool is_rock(std::uint16_t object) const { return object != kNoObject && object >= first_rock_; }
  void look(const Placed& object, const Rays& rays, double* nearest, ObjectLanes& out) const;
  void store(const Placed& object, std::uint32_t triangle, const Rays& rays, int lane, double* nearest,
             ObjectLanes& out) const;

  const FrameRequest& request_;
  std::vector<std::vector<Finish>> finishes_;  // per object, then one for all rocks
  std::vector<Placed> placed_;                 // the request's objects, rocks, soil against rocks
  std::size_t first_rock_ = kNoObject;         // rocks and what follows are traced as one group, relative to the anchor
  std::optional<ObjectGroup> rocks_;
  std::optional<EllipsoidImages> in_image_, toward_sun_;  // of rocks: for rays from the only camera, and toward the Sun
  Vec3 anchor_m_ = Vec3::Zero();
  double rocks_radius_m_ = 0;  // radius of their bounding sphere around the anchor
  bool any_in_view_ = false, from_one_place_;
};

}  // namespace selenograph::engine
