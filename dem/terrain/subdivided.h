// Blocks of levels finer than the posts.
#pragma once

#include <memory>

#include "dem/grid/block.h"

namespace selenograph::dem {

// Returns a block of a finer level, interpolated on the coarse block's triangles in latitude, longitude and height: the
// surface stays the same but follows the sphere. Beside a pole, where steps of longitude do not halve, quads become
// ruled surfaces. Null if it has no valid post.
std::shared_ptr<const Block> subdivided(const Block& coarse, const BlockId& id);

}  // namespace selenograph::dem
