// Levels beyond the posts.
#pragma once

#include <memory>

#include "dem/grid/block.h"

namespace selenograph::dem {

// A block of a finer level, subdivided along the same triangles in latitude, longitude and height, so that the surface
// stays what it was but follows the sphere. Null where it has not one valid post.
std::shared_ptr<const Block> subdivided(const Block& coarse, const BlockId& id);

}  // namespace selenograph::dem
