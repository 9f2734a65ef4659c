// Objects over the terrain, or alone: their visibility, shadows and radiance for packets of pixels.
//
// Rays are transformed to the coordinates of an object in double and start on its bounding sphere; there float finds
// the triangle and double the point. Accuracy therefore does not depend on the position of an object: in lunar orbit,
// on the ground, or next to the Earth.
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
  // Points as for terrain, but without `triangle` and never on the edge of one. The normal of the facet is a unit
  // vector and faces the camera.
  SurfacePoints points;
  Shading shading;
  std::uint16_t object[kPacket];  // index into FrameRequest::objects, then into the rocks; or kNoObject
  std::uint32_t part[kPacket];    // index into the object's materials
  // Lanes that hit a rock, but see the soil against it: they count as ground.
  bool on_soil[kPacket];
};

std::vector<Ball> balls_around(const std::vector<SceneObject>& objects);
// Returns whether the material of any object emits.
bool objects_emit(const std::vector<SceneObject>& objects);

class ObjectsInFrame {
 public:
  // `request` must outlive this object. Rocks and the soil against them have the material of the terrain. Soil is shown
  // if it is at least max_error_px / 2 pixels high, and only against the kMaxRocksWithSoil largest rocks
  // (frame/needs.h).
  ObjectsInFrame(const FrameRequest& request, const RowViews& views, std::span<const dem::RockFeature> rocks = {},
                 const StopToken& stop = {});
  // For rays with arbitrary origins; radiances() then does not apply.
  explicit ObjectsInFrame(const FrameRequest& request, std::span<const dem::RockFeature> rocks = {},
                          const StopToken& stop = {});
  ObjectsInFrame(const ObjectsInFrame&) = delete;
  ObjectsInFrame& operator=(const ObjectsInFrame&) = delete;

  bool empty() const { return placed_.empty(); }
  std::vector<Ball> balls_around_rocks() const;  // bounding balls of all rocks, in view or not
  // Converts an index of ObjectLanes to the index of a rock, if it is a rock, and back.
  std::optional<std::size_t> rock(std::uint16_t object) const {
    return is_rock(object) ? std::optional<std::size_t>(object - first_rock_) : std::nullopt;
  }
  std::uint16_t index_of_rock(std::size_t rock) const { return static_cast<std::uint16_t>(first_rock_ + rock); }

  // Finds the lanes where an object is nearer than the terrain, one bit each. Marks them as neither hit nor valid in
  // the points and rays of the terrain; other members keep their values. `from_camera`: the rays are those of the
  // camera; other rays may hit objects out of its view.
  std::uint32_t intersect(Rays& rays, SurfacePoints& terrain, ObjectLanes& out, bool from_camera = true) const;

  // Returns the requested lanes from whose points an object blocks the direction toward the Sun, one bit each.
  // `own_object`: objects that the points are on; null: on terrain.
  std::uint32_t blocked(const SurfacePoints& points, const std::uint16_t* own_object, std::uint32_t requested,
                        const Vec3& sun) const;

  // Returns whether rocks, seen from a single origin, are the only objects, so that near_rocks() may be asked.
  bool are_only_rocks() const { return first_rock_ == 0 && in_image_ && toward_sun_; }
  // Returns the lanes whose ray from the camera may hit a rock, and those from whose point a rock may block the
  // request's Sun, one bit each. Rays are given by their directions, points in MOON_ME, m.
  std::uint32_t near_rocks(const double dx[kPacket], const double dy[kPacket], const double dz[kPacket],
                           const double x[kPacket], const double y[kPacket], const double z[kPacket]) const {
    const std::uint32_t on_rocks = in_image_->may_hit(dx, dy, dz, kAllLanes);
    return on_rocks | toward_sun_->may_hit(x, y, z, kAllLanes & ~on_rocks);
  }

  // Sets the radiance per lane, W m-2 sr-1: with the Sun (`out`) and without it (`base`). `indirect`: may be null.
  void radiances(const ObjectLanes& lanes, const Rays& rays, const float* lit, const TerrainLight* indirect, float* out,
                 float* base) const;
  // Sets mu0 f_r per lane, sr-1, for light that arrives along the ray.
  void reflected_back(const ObjectLanes& lanes, double* out) const;

 private:
  // `views` null: all objects count as in view, and rays have no common origin.
  ObjectsInFrame(const FrameRequest& request, const RowViews* views);

  struct PartShading {
    Brdf brdf;
    double direct_w_m2;
    float base;
  };
  struct Placed {
    const ObjectMesh* mesh;
    // Maps vectors to the object, including its scale; `normals` maps its normals to MOON_ME, not to unit length.
    Mat3 object_from_moon, normals;
    Vec3 position, tracer_origin;  // MOON_ME, m; tracer_origin: the origin of the rays of the tracer
    double scale;
    Ball ball;
    bool in_view;
    std::uint16_t number;  // ObjectLanes::object
    bool soil;
    double brightness = 1;                          // factor of the reflectance, except on soil
    const std::vector<PartShading>* part_shadings;  // one per part
    Vec3 to_object(const Vec3& point) const { return object_from_moon * (point - position); }
    Vec3 to_tracer(const Vec3& point) const { return object_from_moon * (point - tracer_origin); }
  };

  // Places a mesh. `scale`: upper bound of the factor by which lengths grow.
  Placed placed(const ObjectMesh& mesh, const Vec3& position_m, const Mat3& moon_from_object,
                const Mat3& object_from_moon, double scale) const;
  std::vector<PartShading> shadings_of(const std::vector<Material>& materials) const;
  // Adds the rocks and their soil. `views` null: soil against all rocks; otherwise where it is high enough in the
  // image.
  void place_rocks(std::span<const dem::RockFeature> rocks, const Vec3& anchor_m, const RowViews* views,
                   const StopToken& stop);
  void build_rock_group(const Vec3& anchor_m, const StopToken& stop);
  void intersect_rocks(const Rays& rays, bool from_camera, double* nearest, ObjectLanes& out) const;
  std::uint32_t blocked_by_rocks(const SurfacePoints& points, const std::uint16_t* own_object, std::uint32_t requested,
                                 const Vec3& sun) const;
  double brightness_of(const ObjectLanes& lanes, int i) const {
    return lanes.on_soil[i] ? 1 : placed_[lanes.object[i]].brightness;
  }
  bool is_rock(std::uint16_t object) const { return object != kNoObject && object >= first_rock_; }
  void intersect_object(const Placed& object, const Rays& rays, double* nearest, ObjectLanes& out) const;
  void store(const Placed& object, std::uint32_t triangle, const Rays& rays, int lane, double* nearest,
             ObjectLanes& out) const;

  const FrameRequest& request_;
  std::vector<std::vector<PartShading>> shadings_;  // per object, then one set for all rocks
  std::vector<Placed> placed_;                      // objects of the request, then rocks, then soil against rocks
  std::size_t first_rock_ = kNoObject;  // placed_ from this index on is traced as one group, relative to the anchor
  std::optional<ObjectGroup> rocks_;
  // images of rocks: for rays of a camera with a single origin, and for rays toward the Sun
  std::optional<EllipsoidImages> in_image_, toward_sun_;
  Vec3 anchor_m_ = Vec3::zero();
  double rocks_radius_m_ = 0;  // radius of the bounding sphere of all rocks around the anchor
  bool any_in_view_ = false, single_origin_;
};

}  // namespace selenograph::engine
