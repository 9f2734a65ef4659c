// Bounds on an area's heights from a scan of its files: selection can cull the area without building its pyramid.
#pragma once

#include <optional>

#include "dem/base/stop_token.h"
#include "dem/catalogue/catalogue.h"
#include "dem/grid/lattice.h"
#include "dem/posts/post_kernels.h"
#include "dem/posts/post_source.h"

namespace selenograph::dem {

// Returns bounds of all surfaces of a block: posts, interpolation between them, and filtered levels from its own on.
// They are wider than NodeInfo's by a few metres on level terrain. Empty where bounds are hard to find (near a pole,
// polar or remote files, unreadable files, many layers). Throws Cancelled.
std::optional<HeightRange> survey_heights(const Catalogue& catalogue, const PostSource& source, const BlockId& block,
                                          const StopToken& stop);

// Returns the lowest and highest height of complete rows, evenly spread, of about `posts` posts in all; low > high: no
// post is valid. Throws as Raster does.
HeightRange sampled_heights(const RasterInfo& info, std::size_t posts);

}  // namespace selenograph::dem
