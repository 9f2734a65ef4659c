// Objects over the terrain, or alone: what of them a packet of pixels sees, where they stand in the Sun's way, how they
// shine.
//
// Rays are moved into an object's own coordinates in double and start on the ball around it; there float decides which
// triangle is met and double where. So an object's place costs no accuracy: in lunar orbit, on the ground, or next to
// the Earth.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "dem/detail/rocks_on_ground.h"
#include "engine/camera/row_views.h"
#include "engine/frame/request.h"
#include "engine/radiometry/brdf.h"
#include "engine/scene/selection.h"
#include "engine/support/packet.h"
#include "engine/visibility/embree/object_group.h"

namespace selenograph::engine {

inline constexpr std::uint16_t kNoObject = 65535;

// Sixteen pixels, as far as they see objects.
struct ObjectLanes {
  // As terrain's are, but `triangle`; on no triangle's edge. The facet's normal is unit and faces the camera.
  SurfacePoints points;
  Shading shading;
  std::uint16_t object[kPacket];  // of FrameRequest::objects, then of the rocks; kNoObject
  std::uint32_t part[kPacket];
};

std::vector<Ball> balls_around(const std::vector<SceneObject>& objects);
// Whether any material does.
bool objects_emit(const std::vector<SceneObject>& objects);

class ObjectsInFrame {
 public:
  // `request` outlives it. Rocks are of the terrain's material.
  ObjectsInFrame(const FrameRequest& request, const RowViews& views, std::span<const dem::RockFeature> rocks = {},
                 const StopToken& stop = {});
  // For rays from anywhere. What it tells of radiance is of no camera.
  explicit ObjectsInFrame(const FrameRequest& request, std::span<const dem::RockFeature> rocks = {},
                          const StopToken& stop = {});
  ObjectsInFrame(const ObjectsInFrame&) = delete;
  ObjectsInFrame& operator=(const ObjectsInFrame&) = delete;

  bool empty() const { return placed_.empty(); }
  // Which of the rocks an index of ObjectLanes is, if it is one, and the other way round.
  std::optional<std::size_t> rock(std::uint16_t object) const {
    return is_rock(object) ? std::optional<std::size_t>(object - first_rock_) : std::nullopt;
  }
  std::uint16_t index_of_rock(std::size_t rock) const { return static_cast<std::uint16_t>(first_rock_ + rock); }

  // Where an object is nearer than the terrain: a bit for each lane, which the terrain and its rays lose.
  std::uint32_t meet(Rays& rays, SurfacePoints& terrain, ObjectLanes& out) const;

  // Lanes from whose points an object blocks the way toward the Sun, of those that ask: a bit for each. `own`: objects
  // that the points are on; null: on terrain.
  std::uint32_t blocked(const SurfacePoints& points, const std::uint16_t* own, std::uint32_t asking,
                        const Vec3& sun) const;

  // Per lane, W m-2 sr-1: with the Sun, and what is left without it.
  void radiances(const ObjectLanes& lanes, const Rays& rays, const float* lit, float* out, float* base) const;

 private:
  // Without a view all objects may be seen, by rays that don't come from one place.
  ObjectsInFrame(const FrameRequest& request, const RowViews* views);

  struct Finish {
    Brdf brdf;
    double direct_w_m2;
    float base;
  };
  struct Placed {
    const ObjectMesh* mesh;
    Eigen::Matrix3d moon_from_object, object_from_moon;  // the latter with the scale
    Vec3 position, middle;                               // MOON_ME, m; middle: what the tracer's rays are relative to
    double scale;
    Ball ball;
    bool in_view;
    const std::vector<Finish>* finishes;  // per part
    Vec3 inside(const Vec3& place) const { return object_from_moon * (place - position); }
    Vec3 from_middle(const Vec3& place) const { return object_from_moon * (place - middle); }
  };

  Placed placed(const ObjectMesh& mesh, const Vec3& position_m, const Eigen::Quaterniond& moon_from_object,
                double scale) const;
  std::vector<Finish> finishes_of(const std::vector<Material>& materials) const;
  void place(std::span<const dem::RockFeature> rocks, const Vec3& anchor_m, const StopToken& stop);
  void group(const Vec3& anchor_m, const StopToken& stop);
  void look_at_rocks(const Rays& rays, double* nearest, ObjectLanes& out) const;
  std::uint32_t blocked_by_rocks(const SurfacePoints& points, const std::uint16_t* own, std::uint32_t asking,
                                 const Vec3& sun) const;
  bool is_rock(std::uint16_t object) const { return object != kNoObject && object >= first_rock_; }
  void look(const Placed& object, std::uint16_t index, const Rays& rays, double* nearest, ObjectLanes& out) const;
  void store(const Placed& object, std::uint16_t index, std::uint32_t triangle, const Rays& rays, int lane,
             double* nearest, ObjectLanes& out) const;

  const FrameRequest& request_;
  std::vector<std::vector<Finish>> finishes_;  // of each object, then of all rocks
  std::vector<Placed> placed_;
  std::size_t first_rock_ = kNoObject;  // of those placed; they are traced together, relative to the anchor
  std::optional<ObjectGroup> rocks_;
  Vec3 anchor_m_ = Vec3::Zero();
  double rocks_radius_m_ = 0;  // of a ball around the anchor that holds them
  bool any_in_view_ = false, from_one_place_;
};

}  // namespace selenograph::engine
