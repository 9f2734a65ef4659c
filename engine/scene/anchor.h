// The origin of a frame's float coordinates.
#pragma once

#include <optional>
#include <span>

#include "dem/grid/geodesy.h"
#include "dem/terrain/terrain.h"

namespace selenograph::engine {

// Spacing and height of a scene's finest posts, if they are closer than a metre.
struct FineGround {
  double finest_m, height_m;
};
// Returns the finest posts of some blocks; empty if they are a metre apart or more.
std::optional<FineGround> fine_ground(std::span<const dem::BlockId> blocks, const dem::Terrain& terrain);

// Returns the origin of a frame's float coordinates: near the camera or, for a distant camera, near the surface in the
// view's middle. It is snapped to a lattice of 4096 m, so that consecutive frames share it. If nothing is nearer to the
// camera than `clearance_m`, the lattice is up to four times that wide, at most 32768 m. Float then resolves a
// microradian from the camera. Low over posts closer than a metre the lattice is finer, so that float resolves 3e-5 of
// their spacing: shadows at a grazing Sun depend on ground that near.
Vec3 anchor_for(const Vec3& camera_m, const Vec3& middle, double clearance_m = 0,
                const std::optional<FineGround>& fine = {});

}  // namespace selenograph::engine
