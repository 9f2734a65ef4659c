// Grids whose posts coincide.
#pragma once

#include <cstdint>
#include <optional>
#include <utility>

#include "dem/grid/post_grid.h"

namespace selenograph::dem {

// Column and row in `grid` of the first post of `other`; empty: the posts of `other` are not on this grid.
std::optional<std::pair<std::int64_t, std::int64_t>> shift_between(const PostGrid& grid, const PostGrid& other);

}  // namespace selenograph::dem
