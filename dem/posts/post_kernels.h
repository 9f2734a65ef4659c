// Vectorised loops over rows of posts. NaN is no-data: comparisons with it are false.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "dem/grid/block.h"

namespace selenograph::dem {

// Extends the range by `n` heights.
void extend_range(const float* heights, int n, HeightRange& range);

// Largest distance between two rows of heights, or `worst` if that is larger.
float largest_distance(const float* a, const float* b, int n, float worst);

// out[i] = below[i] + 2 here[i] + above[i].
void add_three_rows(const float* below, const float* here, const float* above, int n, float* out);

// Filters and halves a row: out[i] = (row[2 i - 1] + 2 row[2 i] + row[2 i + 1]) / 16, rounded to a multiple of `step`,
// a power of two, halves to even. Exact for heights below 2^22 steps.
void halve_row(const float* row, int n, float step, float* out);
// out[i] = row[i] * factor, rounded to a multiple of `step`.
void quantise_row(const float* row, int n, float factor, float step, float* out);

// One row of a surface at its posts and half-way between: 2 quads + 1.
void refine_row(const float* a, int quads, float* out);
// The row half-way to the next one, `b`, by triangles whose diagonals run from the south-east to the north-west.
void refine_between_rows(const float* a, const float* b, int quads, float* out);

// Takes a layer's valid heights for the posts of a row that have none yet (kNoSource).
struct Taken {
  int filled = 0, impossible = 0;
};
Taken take_row(const float* layer, int n, SourceMark mark, float* heights, SourceMark* sources);

// Places between the posts of a row, ascending: for each the first of the four posts around it, and their weights.
struct RowPlaces {
  const std::int32_t* first;
  std::array<const double*, 4> weights;
};
// out[i] = weighted sum of the four posts around a place. `row_size`: posts that may be read.
void interpolate_row(const float* row, int row_size, const RowPlaces& places, int n, double* out);
// out[i] = weighted sum of four rows.
void add_four_rows(const std::array<const double*, 4>& rows, const std::array<double, 4>& weights, int n, float* out);

// Number of leading values equal to the first; 0 if there are none.
std::size_t count_equal(const std::uint32_t* values, std::size_t n);

}  // namespace selenograph::dem
