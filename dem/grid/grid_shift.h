// Offset between two grids whose posts coincide.
#pragma once

#include <cstdint>
#include <optional>
#include <utility>

#include "dem/grid/post_grid.h"

namespace selenograph::dem {

// Returns the column and row in `grid` of the first post of `shifted`; empty if posts of `shifted` do not coincide with
// posts of `grid`.
std::optional<std::pair<std::int64_t, std::int64_t>> shift_between(const PostGrid& grid, const PostGrid& shifted);

}  // namespace selenograph::dem
