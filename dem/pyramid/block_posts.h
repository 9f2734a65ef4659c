// Composes a block at the posts' own level from the files, as in the base of a chunk.
#pragma once

#include <cstdint>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/grid/block.h"
#include "dem/posts/post_source.h"

namespace selenograph::dem {

// Returns the longitude step of a level's grid: that of the chunk's rows nearest to the equator, the finest that any of
// its blocks needs.
Tick grid_lon_step(const BlockId& node, int level);

// Posts of one block, with a halo for shading normals.
struct PostsOfBlock {
  std::vector<float> heights;       // (quads + 1 + 2 kHalo)^2
  std::vector<SourceMark> sources;  // (quads + 1)^2, with the catalogue's indices
  std::vector<SourceIndex> replaced;
};
// Composes a block of a chunk from the files. `node`: the chunk's node.
PostsOfBlock compose_block(const BlockId& node, const BlockId& id, const PostSource& source, const StopToken& stop);
// The same from the catalogue's first `files` files only.
PostsOfBlock compose_block(const BlockId& node, const BlockId& id, const PostSource& source, int files,
                           const StopToken& stop);

}  // namespace selenograph::dem
