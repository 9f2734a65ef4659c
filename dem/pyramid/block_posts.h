// Composes a block at the posts' own level from the files, as in the base of a chunk.
#pragma once

#include <cstdint>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/grid/block.h"
#include "dem/posts/post_source.h"

namespace selenograph::dem {

// Longitude step of a level's grid: that of the chunk's rows nearest the equator, the finest that any of its blocks
// needs.
std::int32_t grid_lon_step(const BlockId& node, int level);

struct PostsOfBlock {
  std::vector<float> heights;       // (quads + 1 + 2 kHalo)^2
  std::vector<SourceMark> sources;  // (quads + 1)^2, by the catalogue's numbers
  std::vector<SourceIndex> replaced;
};
// `node`: the chunk's.
PostsOfBlock compose_block(const BlockId& node, const BlockId& id, const PostSource& source, const StopToken& stop);
// Uses only the first `files` of the catalogue.
PostsOfBlock compose_block(const BlockId& node, const BlockId& id, const PostSource& source, int files,
                           const StopToken& stop);

}  // namespace selenograph::dem
