// The origin of a frame's float coordinates.
#pragma once

#include <optional>
#include <span>

#include "dem/grid/geodesy.h"
#include "dem/terrain/terrain.h"

namespace selenograph::engine {

// The finest posts of a scene, where they are closer than a metre, and their height.
struct FineGround {
  double finest_m, height_m;
};
std::optional<FineGround> fine_ground(std::span<const dem::BlockId> blocks, const dem::Terrain& terrain);

// Returns the origin of a frame's float coordinates: near the camera or, for a distant camera, near the surface in the
// view's middle. It is snapped to a lattice of 4096 m, so that consecutive frames share it; if nothing is nearer to the
// camera than `clearance_m`, to a lattice of up to four times that, at most 32768 m. Float then resolves a microradian
// as seen from the camera. Low over posts closer than a metre the lattice is finer, so that float resolves 3e-5 of
// these: shadows at a grazing Sun depend on what is that near.
Vec3 anchor_for(const Vec3& camera_m, const Vec3& middle, double clearance_m = 0,
                const std::optional<FineGround>& fine = {});

}  // namespace selenograph::engine
