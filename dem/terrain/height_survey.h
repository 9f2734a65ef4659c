// Bounds on an area's heights from a scan of its files, so that a pyramid that cannot matter need not be built.
#pragma once

#include <optional>

#include "dem/base/stop_token.h"
#include "dem/catalogue/catalogue.h"
#include "dem/grid/lattice.h"
#include "dem/posts/post_kernels.h"
#include "dem/posts/post_source.h"

namespace selenograph::dem {

// Bounds of all surfaces of the block: posts, interpolation between them, and filtered levels, its own and finer ones.
// Wider than NodeInfo's by a few metres on level terrain. Empty where they are hard to find (near a pole, polar or
// remote files, unreadable files, many layers). Throws Cancelled.
std::optional<HeightRange> survey_heights(const Catalogue& catalogue, const PostSource& source, const BlockId& block,
                                          const StopToken& stop);

// Lowest and highest height of whole rows, evenly spread, of about `posts` posts in all; low > high: none is valid.
// Throws as Raster does.
HeightRange sampled_heights(const RasterInfo& info, std::size_t posts);

}  // namespace selenograph::dem
