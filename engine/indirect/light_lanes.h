// Indirect light at sixteen pixels, interpolated between posts.
#pragma once

#include "engine/indirect/light_field.h"
#include "engine/indirect/slope_light.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// Irradiance of a surface: from the Sun directly, reflected by terrain, from the Earth.
struct Irradiance {
  double direct_w_m2 = 0, terrain_w_m2 = 0, earth_w_m2 = 0;
};

// Sums over the sectors of a post, and the two quantities without direction.
struct LightSum {
  float x = 0, y = 0, z = 0;  // sum of the sectors' vectors
  float fluence = 0;          // sum of their lengths
  float earth = 0;            // visible share of the Earth's disc
  float ground = 0;           // radiosity of the ground itself
  float unused[2] = {};
};
// Light from terrain at a post, for a Sun of 1 W m-2 at normal incidence: a vector per sector of azimuth, see
// SectorLight.
struct alignas(64) LightPost {
  float x[kSectors] = {}, y[kSectors] = {}, z[kSectors] = {};
  LightSum sum;
};
static_assert(sizeof(LightPost) == 4 * kSectors * sizeof(float));

// Sun and Earth: irradiance at normal incidence, W m-2; direction of the Earth (unit, MOON_ME).
struct LightSources {
  double sun_w_m2 = 0, earth_w_m2 = 0;
  Vec3 earth = Vec3::zero();
  double earth_radius = 0;  // angular radius of its disc, rad
  // Returns the share of the Earth's disc above the horizon of level ground.
  double earth_above_level(const Vec3& place_m) const {
    return earth_w_m2 > 0 ? share_of_disc_above(-place_m.normalized().dot(earth) / earth_radius) : 0;
  }
};

// A position among the posts of a tile, FieldPlane::kTileSide a row: the post south-west of it, and the shares of the
// way to the next posts, 0 to 1.
//
//    o-------------o        weight of the post in the
//    |      :      |          north-west  (1 - east) north       north-east  east north
//    |......x      |          south-west  (1 - east) (1 - north) south-east  east (1 - north)
//    o-------------o
//   post
struct BetweenPosts {
  const LightPost* post;
  float east, north;
};

// Interpolates the sums of the four posts around a position.
LightSum sum_between(const BetweenPosts& position);
// Returns the irradiance of a surface from terrain and from the Earth.
Irradiance irradiance_at(const BetweenPosts& position, const Vec3& normal, const LightSources& sources);
// Returns the Earth's irradiance above level ground, for positions without posts.
Irradiance irradiance_on_level(const Vec3& place_m, const Vec3& normal, const LightSources& sources);

// Positions of sixteen points in a field: the tile, the post of it south-west of the point, and the shares of the way
// to the next posts. Points outside the field are clamped to its border.
struct alignas(64) FieldLanes {
  int tile[kPacket], post[kPacket];
  float east[kPacket], north[kPacket];
};
void set_field_lanes(const FieldPlane& plane, const SurfacePoints& points, FieldLanes& out);

// Light interpolated between posts, per lane: the irradiance, and the sums that are the same for all normals. Lanes
// without light are zero.
struct alignas(64) TerrainLanes {
  float arrives[kPacket] = {};  // irradiance of the pixel's surface
  float x[kPacket] = {}, y[kPacket] = {}, z[kPacket] = {}, fluence[kPacket] = {}, earth[kPacket] = {};  // see LightSum
  float factor[kPacket] = {};  // correction of the reflectance, see light_factors.h
};
// Sets the lanes in the bit mask `lanes`, which are all in the tile of these posts. Each sector's light counts if the
// normal faces it. `factors`: of the posts, see light_factors.h.
void read_posts(const LightPost* posts, const float* factors, const FieldLanes& positions, std::uint32_t lanes,
                const Shading& shading, TerrainLanes& out);

// Light from terrain or from the Earth as from one direction, per lane, for the Brdf.
struct alignas(64) DiffuseLanes {
  double mu0[kPacket], cos_phase[kPacket];
  double light[kPacket];  // irradiance at normal incidence, W m-2; 0: none
};

// Set the light of a packet from terrain and from the Earth. Lanes without light get mu0 1e-9, because the Brdf is
// undefined at 0.
void light_from_terrain(const TerrainLanes& lanes, const Rays& rays, double sun_w_m2, DiffuseLanes& out);
void light_from_earth(const TerrainLanes& lanes, const SurfacePoints& points, const Shading& shading, const Rays& rays,
                      const LightSources& sources, DiffuseLanes& out);

// Adds the reflected light to the radiance. `reflected`: mu0 f_r per lane; `albedo`: null, or a factor per lane.
void add_reflected(const DiffuseLanes& lanes, const double* reflected, const double* albedo, float* radiance);

}  // namespace selenograph::engine
