// Indirect light over a frame's mesh: from the terrain around, and from the Earth.
//
// Where posts would be too far apart (kLargestLitPixel_m), there is the Earth's alone, as over level ground.
//
// Gathered at posts (light_tile.h) in sectors of azimuth, which are interpolated between them. At a point with normal n
// the irradiance is the sum over sectors of the dot product of n with the sector's vector, where that is positive; the
// radiance is that of light from one direction with the same irradiance and mean cosine of incidence, times a factor
// that makes it exact at the posts (light_factors.h).
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "engine/frame/queries.h"
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
  // Throws TooMuchTerrain where the posts do not fit into the memory for them. `viewer_m`: left out, the view's
  // cameras. `direct_w_m2`: the Sun's, at normal incidence. The request and the view's mesh must outlive this object.
  TerrainLight(const FrameRequest& request, const ViewOfGround& view, const std::optional<Vec3>& viewer_m,
               const dem::Terrain& terrain, double direct_w_m2, LightTiles& tiles, const StopToken& stop);

  // Adds the radiance of the indirect light, W m-2 sr-1, for lanes that hit. `albedo`: null, or what the map says: w of
  // Hapke's model, otherwise a factor of what the Brdf reflects.
  void add(const SurfacePoints& points, const Shading& shading, const Rays& rays, const Brdf& brdf,
           const double* albedo, float* radiance) const;
  // At a lane, for its normal; without direct sunlight, like those below.
  Irradiance irradiance(const SurfacePoints& points, int lane, const Vec3& normal) const;

  // The largest share V of its hemisphere that a post in view sees as ground. Light that is reflected more often than n
  // times is at most (a V)^n / (1 - a V) of the largest irradiance from terrain, a being the albedo.
  double most_ground_view() const { return most_ground_view_; }

  // At any place near the mesh, as on an object: above the ground, whose light comes from below.
  struct Place {
    Vec3 terrain = Vec3::Zero(), earth = Vec3::Zero();  // vectors of the light, W m-2
    double ground = 0;                                  // radiosity of the ground below, W m-2
    Vec3 up = Vec3::UnitZ();
    Irradiance on(const Vec3& normal) const;
  };
  // `object`: its number, or a larger one of a rock.
  Place on_objects(const Vec3& place_m, std::size_t object) const;

 private:
  struct Tile {
    std::shared_ptr<const LightTile> light;
    TileRows rows;  // in view
    std::array<float, LightTile::kPosts> factors;
  };
  struct Field {
    FieldPlane plane;
    std::vector<const Tile*> tiles;  // row by row; null: not in view
  };
  void read(const SurfacePoints& points, const Shading& shading, TerrainLanes& out) const;
  std::optional<LightPlace> at(int field, const Vec3& place_m) const;
  std::optional<LightPlace> below(const Vec3& place_m, std::size_t object) const;

  const FrameRequest& request_;
  const Mesh& mesh_;
  LightSources sources_;
  double most_ground_view_ = 0;
  std::vector<Tile> tiles_;
  std::vector<Field> fields_;
  std::vector<int> of_block_, of_object_;  // field of each block of the mesh, and below objects; -1: none
  std::vector<Vec3> objects_m_;            // their middles
  std::optional<Fade> fade_;
};

}  // namespace selenograph::engine
