// Indirect light over a frame's mesh: from the surrounding terrain and from the Earth.
//
// Light is gathered at posts (light_tile.h) in sectors of azimuth, each interpolated between posts. At a point with
// normal n the irradiance is the sum over sectors of the dot product of n with the sector's vector, where positive. The
// radiance is that of light from one direction with the same irradiance and mean cosine of incidence, times a factor
// that makes it exact at the posts (light_factors.h).
//
// In pixels above kLargestLitPixel_m there is only earthlight, as over level ground.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "engine/frame/request.h"
#include "engine/indirect/fields_in_view.h"
#include "engine/indirect/light_field.h"
#include "engine/indirect/light_lanes.h"
#include "engine/indirect/light_tile.h"
#include "engine/radiometry/brdf.h"
#include "engine/scene/mesh.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

class TerrainLight {
 public:
  // Gathers the light at all posts that the frame needs. Throws TooMuchTerrain if they exceed the memory for tiles.
  // `viewer_m`: without it, the view's cameras. `direct_w_m2`: the Sun's irradiance at normal incidence. The request
  // and the view's mesh must outlive this object.
  TerrainLight(const FrameRequest& request, const ViewOfGround& view, const std::optional<Vec3>& viewer_m,
               const dem::Terrain& terrain, double direct_w_m2, LightTiles& tiles, const StopToken& stop);

  // Adds the radiance of the indirect light, W m-2 sr-1, in lanes that hit. `albedo`: null, or the map's value: w of
  // Hapke's model, otherwise a factor of the Brdf.
  void add(const SurfacePoints& points, const Shading& shading, const Rays& rays, const Brdf& brdf,
           const double* albedo, float* radiance) const;
  // Returns the irradiance at a lane for a normal, without direct sunlight.
  Irradiance irradiance(const SurfacePoints& points, int lane, const Vec3& normal) const;

  // Largest share V of its hemisphere that a post in view sees as ground. Light that is reflected more than n times is
  // at most (a V)^n / (1 - a V) of the largest irradiance from terrain, with albedo a.
  double max_ground_view() const { return max_ground_view_; }
  // Returns the times of gathering.
  const LightTimes& times() const { return times_; }

  // Light at a position near the mesh, as on an object: above the ground, with light from below.
  struct ObjectLight {
    Vec3 terrain = Vec3::zero(), earth = Vec3::zero();  // vectors of the light, W m-2, MOON_ME
    double ground = 0;                                  // radiosity of the ground below, W m-2
    Vec3 up = Vec3::unit_z();
    Irradiance on(const Vec3& normal) const;
  };
  // Returns the light on an object or rock. `object`: the object's index; larger indices are rocks.
  ObjectLight on_objects(const Vec3& position_m, std::size_t object) const;

 private:
  struct Tile {
    std::shared_ptr<const LightTile> light;
    TileRows rows;  // rows in view
    std::array<float, LightTile::kPosts> factors;
  };
  struct Field {
    FieldPlane plane;
    std::vector<const Tile*> tiles;  // row by row; null: out of view
  };
  // Interpolates the light of all lanes that hit, field by field and tile by tile.
  void read(const SurfacePoints& points, const Shading& shading, TerrainLanes& out) const;
  // Returns the posts around a position in the field with this index; empty if they are not in view.
  std::optional<BetweenPosts> posts_at(int field, const Vec3& position_m) const;
  // Returns the posts in view around the point below a position; else those of the object, as far as they reach, or
  // those below its middle.
  std::optional<BetweenPosts> below(const Vec3& position_m, std::size_t object) const;

  const FrameRequest& request_;
  const Mesh& mesh_;
  LightSources sources_;
  double max_ground_view_ = 0;
  LightTimes times_;
  std::vector<Tile> tiles_;
  std::vector<Field> fields_;
  // Index of the field of each block of the mesh, and of the field below each object; -1: none.
  std::vector<int> field_of_block_, field_of_object_;
  std::vector<Vec3> objects_m_;  // centres of the objects
  std::optional<Fade> fade_;
};

}  // namespace selenograph::engine
