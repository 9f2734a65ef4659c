// Between which heights an area's terrain lies, by one look at its files: a pyramid that can't matter need not be
// built.
#pragma once

#include <optional>

#include "dem/catalogue/catalogue.h"
#include "dem/grid/lattice.h"
#include "dem/posts/post_kernels.h"
#include "dem/posts/post_source.h"
#include "dem/support/stop_token.h"

namespace selenograph::dem {

// Bounds of every surface of the block: of the posts beneath it, of what is interpolated between them, and of the
// coarser levels made of those, its own and finer ones. Wider than NodeInfo's, by a few metres where terrain is level.
// Nothing where they would be hard to tell (near a pole, a polar or remote file, one that can't be read, many layers).
// Throws Cancelled.
std::optional<HeightRange> survey_heights(const Catalogue& catalogue, const PostSource& source, const BlockId& block,
                                          const StopToken& stop);

}  // namespace selenograph::dem
