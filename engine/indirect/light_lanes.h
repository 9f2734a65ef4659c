// Indirect light at sixteen pixels, between posts.
#pragma once

#include "engine/frame/queries.h"
#include "engine/indirect/light_field.h"
#include "engine/indirect/slope_light.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// A post as pixels read it: 128 bytes.
struct alignas(64) LightPost {
  float from[3][kSectors] = {};  // vectors of the light from terrain, by sectors of azimuth, W m-2
  float x = 0, y = 0, z = 0;     // their sum
  float fluence = 0;             // sum of their lengths
  float factor = 1;              // of the radiance, see terrain_light.h
  float earth = 0;               // W m-2 at normal incidence
  float ground = 0;              // radiosity of the ground, W m-2
  float unused = 0;
};

// The post south-west of a pixel's place, and how far the place is towards the next ones, 0 to 1. The post east of it
// follows it; the one north of it comes after `row` posts.
struct LightPlace {
  const LightPost* post;
  float east, north;
  int row;
};

LightPost post_between(const LightPlace& place);
// From terrain, and from the Earth in that direction, on a surface there.
Irradiance irradiance_at(const LightPlace& place, const Vec3& normal, const Vec3& earth);

// Where sixteen points are in a field: the tile, the post of it south-west of the point, and how far beyond that post.
// Points beside the field are at its border. `all`: all lanes have points.
struct alignas(64) FieldLanes {
  int tile[kPacket], post[kPacket];
  float east[kPacket], north[kPacket];
};
void places_in_field(const FieldPlane& plane, const SurfacePoints& points, bool all, FieldLanes& out);

// What reflects towards the camera: light of a terrain's or the Earth's as of one direction.
struct alignas(64) DiffuseLanes {
  double mu0[kPacket], cos_phase[kPacket];
  double light[kPacket];  // W m-2 at normal incidence; 0: none
};

// From terrain; each sector's light counts where the normal faces it. Lanes without light have a mu0 of 1e-9. `earth`:
// that of the post.
void light_from_terrain(const LightPlace (&places)[kPacket], const SurfacePoints& points, const Shading& shading,
                        const Rays& rays, DiffuseLanes& out, float (&earth)[kPacket]);
// From one direction, unit, that each lane gets `earth` of.
void light_from_earth(const float (&earth)[kPacket], const SurfacePoints& points, const Shading& shading,
                      const Rays& rays, const Vec3& direction, DiffuseLanes& out);

// Adds to the radiance what the light's lanes reflect of `reflected`, mu0 f_r; `albedo`: null, or a factor per lane.
void add_reflected(const DiffuseLanes& lanes, const double* reflected, const double* albedo, float* radiance);

}  // namespace selenograph::engine
