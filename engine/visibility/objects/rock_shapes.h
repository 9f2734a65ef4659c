// Shapes of rocks and of the soil against them: a few meshes, turned, stretched and sunk into the ground rock by rock.
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "dem/detail/rock_field.h"
#include "engine/frame/objects.h"

namespace selenograph::engine {

// kStones stones in kRoundings states each, stone by stone: cut by planes with sharp edges, with chipped ones, and
// rounded. Their size is arbitrary, z is not up. Made once.
inline constexpr std::size_t kStones = 8, kRoundings = 3;
const std::vector<std::shared_ptr<const ObjectMesh>>& rock_shapes();
// Mounds of soil around a rock, which hides their middle: z is up, 0 is the ground. Their height is about 1 at 0.7 from
// the axis. They meet the ground at a small angle at about 1, and continue below it to 1.16: where the ground falls
// away they still reach it. Made once.
const std::vector<std::shared_ptr<const ObjectMesh>>& fillet_shapes();

// A mesh on the ground.
struct PlacedShape {
  const ObjectMesh* mesh;
  Eigen::Affine3d from_mesh;  // axes of MOON_ME, relative to the rock's position, metres
};

// Where the ground's normal is `up`. Its largest horizontal extent is the rock's diameter, its top is height_m above
// the ground. Any of some hundred attitudes of the shapes is chosen, older rocks are rounder; all are stretched
// vertically, by the height, narrowed to 0.6 to 1 of the width across the largest extent, and turned about the
// vertical. All of it is within a diameter of the rock's position, and so is its fillet.
PlacedShape placed_rock(const dem::Rock& rock, const Vec3& up);
// The soil against it, 1.3 to 1.5 times as wide; none where it is lower than 2 % of the diameter.
std::optional<PlacedShape> placed_fillet(const dem::Rock& rock, const Vec3& up);

}  // namespace selenograph::engine
