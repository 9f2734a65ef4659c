// Vectorised loops over rows of posts. NaN means no data: every comparison with it is false.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "dem/grid/block.h"

namespace selenograph::dem {

// Extends the range by `n` heights. NaN does not change it.
void extend_range(const float* heights, int n, HeightRange& range);

// Returns the largest distance between two rows of heights, or `worst` if that is larger.
float largest_distance(const float* a, const float* b, int n, float worst);

// out[i] = below[i] + 2 here[i] + above[i].
void add_three_rows(const float* below, const float* here, const float* above, int n, float* out);

// Filters and halves a row: out[i] = (row[2 i - 1] + 2 row[2 i] + row[2 i + 1]) / 16, rounded to a multiple of `step`,
// a power of two, halves to even. Exact for heights below 2^22 steps.
void halve_row(const float* row, int n, float step, float* out);
// out[i] = row[i] * factor, rounded to a multiple of `step`.
void quantise_row(const float* row, int n, float factor, float step, float* out);

// Writes a row of a surface at its posts and half-way between them: 2 quads + 1 heights.
void refine_row(const float* a, int quads, float* out);
// Writes the row half-way between row `a` and the next row `b`, on triangles whose diagonals run from the south-east to
// the north-west.
void refine_between_rows(const float* a, const float* b, int quads, float* out);

// Copies a layer's valid heights to the posts of a row that have none yet (kNoSource), and marks their source. Returns
// how many it has copied.
int fill_missing(const float* layer, int n, SourceMark mark, float* heights, SourceMark* sources);

// Taps of cubic interpolation at ascending positions along a row of posts.
struct RowTaps {
  const std::int32_t* first;             // per position: the first of the four posts around it
  std::array<const double*, 4> weights;  // per position: weights of the four posts
};
// out[i] = weighted sum of the four posts around a position. `row_size`: number of posts that may be read.
void interpolate_row(const float* row, int row_size, const RowTaps& taps, int n, double* out);
// out[i] = weighted sum of four rows.
void add_four_rows(const std::array<const double*, 4>& rows, const std::array<double, 4>& weights, int n, float* out);

// Returns the number of leading values equal to the first; 0 if there are no values.
std::size_t count_equal(const std::uint32_t* values, std::size_t n);

}  // namespace selenograph::dem
