// Indirect light at sixteen pixels, between posts.
#pragma once

#include <span>

#include "engine/support/packet.h"

namespace selenograph::engine {

// A post as pixels read it: 32 bytes.
struct alignas(32) LightPost {
  float x = 0, y = 0, z = 0;  // vector of the light from terrain, W m-2
  float fluence = 0;          // sum of the sectors' lengths
  float factor = 1;           // of the radiance, see terrain_light.h
  float earth = 0;            // W m-2 at normal incidence
  float ground = 0;           // radiosity of the ground, W m-2
  float unused = 0;
};

// The post south-west of a pixel's place, and how far the place is towards the next ones, 0 to 1. The post east of it
// follows it; the one north of it comes after `row` posts.
struct LightPlace {
  const LightPost* post;
  float east, north;
  int row;
};

void posts_between(std::span<const LightPlace> places, LightPost* out);

// What reflects towards the camera: light of a terrain's or the Earth's as of one direction.
struct alignas(64) DiffuseLanes {
  double mu0[kPacket], cos_phase[kPacket];
  double light[kPacket];  // W m-2 at normal incidence; 0: none
};

// From terrain. Lanes without light have a mu0 of 1e-9.
void light_from_terrain(const LightPost (&posts)[kPacket], const SurfacePoints& points, const Shading& shading,
                        const Rays& rays, DiffuseLanes& out);
// From one direction, unit, that each lane gets `light` of.
void light_from_earth(const LightPost (&posts)[kPacket], const SurfacePoints& points, const Shading& shading,
                      const Rays& rays, const Vec3& direction, DiffuseLanes& out);

// Adds light times reflected, of mu0 f_r, times the albedo if there is one.
void add_reflected(const DiffuseLanes& lanes, const double* reflected, const double* albedo, float* radiance);

}  // namespace selenograph::engine
