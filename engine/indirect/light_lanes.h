// Indirect light at sixteen pixels, between posts.
#pragma once

#include "engine/frame/queries.h"
#include "engine/indirect/light_field.h"
#include "engine/indirect/slope_light.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

struct LightSum {
  float x = 0, y = 0, z = 0;  // sum of the sectors' vectors
  float fluence = 0;          // sum of their lengths
  float earth = 0;            // share of the Earth's disc that is seen
  float ground = 0;           // radiosity of the ground itself
  float unused[2] = {};
};
// Light at a post, for a Sun of 1 W m-2 at normal incidence: from terrain, by sectors of azimuth, see SectorLight.
struct alignas(64) LightPost {
  float x[kSectors] = {}, y[kSectors] = {}, z[kSectors] = {};
  LightSum sum;
};
static_assert(sizeof(LightPost) == 4 * kSectors * sizeof(float));

// What shines: W m-2 at normal incidence, and where the Earth is (unit, MOON_ME).
struct LightSources {
  double sun_w_m2 = 0, earth_w_m2 = 0;
  Vec3 earth = Vec3::Zero();
  double earth_radius = 0;  // of its disc, rad
  // The share of the Earth's disc above the horizon of level ground.
  double earth_above_level(const Vec3& place_m) const {
    return earth_w_m2 > 0 ? share_of_disc_above(-place_m.normalized().dot(earth) / earth_radius) : 0;
  }
};

// The post south-west of a place, of a tile of FieldPlane::kTileSide posts a row, and how far the place is towards the
// next ones, 0 to 1.
struct LightPlace {
  const LightPost* post;
  float east, north;
};

LightSum sum_between(const LightPlace& place);
// From terrain, and from the Earth, on a surface there.
Irradiance irradiance_at(const LightPlace& place, const Vec3& normal, const LightSources& sources);
// Where there are no posts.
Irradiance irradiance_on_level(const Vec3& place_m, const Vec3& normal, const LightSources& sources);

// Where sixteen points are in a field: the tile, the post of it south-west of the point, and how far beyond that post.
// Points beside the field are at its border.
struct alignas(64) FieldLanes {
  int tile[kPacket], post[kPacket];
  float east[kPacket], north[kPacket];
};
void places_in_field(const FieldPlane& plane, const SurfacePoints& points, FieldLanes& out);

// Between the posts of each lane: the irradiance, and what is the same for all normals. Lanes without light are zero.
struct alignas(64) TerrainLanes {
  float arrives[kPacket] = {}, x[kPacket] = {}, y[kPacket] = {}, z[kPacket] = {}, fluence[kPacket] = {},
        factor[kPacket] = {}, earth[kPacket] = {};
};
// Those of some lanes, a bit each, that are in a tile of these posts; each sector's light counts where the normal faces
// it. `factors`: of the posts, see light_factors.h.
void read_posts(const LightPost* posts, const float* factors, const FieldLanes& at, std::uint32_t lanes,
                const Shading& shading, TerrainLanes& out);

// What reflects towards the camera: light of a terrain's or the Earth's as of one direction.
struct alignas(64) DiffuseLanes {
  double mu0[kPacket], cos_phase[kPacket];
  double light[kPacket];  // W m-2 at normal incidence; 0: none
};

// Lanes without light have a mu0 of 1e-9.
void light_from_terrain(const TerrainLanes& lanes, const Rays& rays, double sun_w_m2, DiffuseLanes& out);
void light_from_earth(const TerrainLanes& lanes, const SurfacePoints& points, const Shading& shading, const Rays& rays,
                      const LightSources& sources, DiffuseLanes& out);

// Adds to the radiance what the light's lanes reflect of `reflected`, mu0 f_r; `albedo`: null, or a factor per lane.
void add_reflected(const DiffuseLanes& lanes, const double* reflected, const double* albedo, float* radiance);

}  // namespace selenograph::engine
