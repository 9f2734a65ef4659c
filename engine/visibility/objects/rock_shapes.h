// Shapes of rocks and of the soil against them: a few meshes, rotated, stretched and sunk into the ground for each
// rock.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "dem/detail/rock_field.h"
#include "engine/frame/objects.h"
#include "engine/support/affine.h"

namespace selenograph::engine {

// Returns the stones: kStones shapes in kRoundings states each, stone by stone: cut by planes with sharp edges, with
// chipped edges, and with rounded edges between facets. Their size is arbitrary, and z is not up. Made once.
inline constexpr std::size_t kStones = 8, kRoundings = 3;
const std::vector<std::shared_ptr<const ObjectMesh>>& rock_shapes();
// Returns the mounds of soil around a rock, which hides their middle. z is up, 0 is the ground; the height at a radius
// of 0.7 is about 1, on some sides next to nothing. They enter the ground at radii of 0.8 to 1.1, and continue below it
// to 1.13, so that they also reach ground that falls away. Lumps lie on them. Made once.
const std::vector<std::shared_ptr<const ObjectMesh>>& fillet_shapes();

// A mesh on the ground.
struct PlacedShape {
  const ObjectMesh* mesh;
  Affine from_mesh;  // in axes of MOON_ME, relative to the position of the rock, metres
};

// Places a rock on ground with the normal `up`. Its largest horizontal extent is the diameter of the rock, its top is
// height_m above the ground. The form of the rock selects one of some hundred attitudes of the shapes; older rocks are
// rounder. The shape is stretched vertically to the height, narrowed to 0.6 to 1 of the width across its largest
// extent, and rotated about the vertical. The rock and its fillet lie within a diameter of the position of the rock.
PlacedShape placed_rock(const dem::Rock& rock, const Vec3& up);
// Places the soil against a rock, up to 1.3 to 1.5 times as wide; none if it is lower than 2 % of the diameter.
std::optional<PlacedShape> placed_fillet(const dem::Rock& rock, const Vec3& up);

}  // namespace selenograph::engine
