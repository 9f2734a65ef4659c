#include "server/commands/coverage.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace selenograph::server {
namespace {

constexpr double kInset_deg = 0.01;  // a file that only shares a cell's border does not cover it
constexpr int kLongitudes = 360;

// Box of one-degree cells, half open: row 0 at the south pole, columns eastward from -180 degrees and not wrapped.
struct Box {
  int south, north, west, east;
};

// Returns the shortest range of columns that holds all used ones: the complement of the longest unused run, which may
// wrap around the date line.
std::pair<int, int> used_columns(const std::array<bool, kLongitudes>& used) {
  // Go round twice, so that a run across the date line is counted whole.
  int best_start = 0, best_length = 0, length = 0;
  for (int i = 0; i < 2 * kLongitudes; ++i) {
    length = used[static_cast<std::size_t>(i % kLongitudes)] ? 0 : length + 1;
    if (length > best_length && length <= kLongitudes) {
      best_length = length;
      best_start = i - length + 1;
    }
  }
  const int west = (best_start + best_length) % kLongitudes;
  return {west, west + kLongitudes - best_length};
}

// Returns the box that contains all files of the catalogue.
Box bounds(const dem::Catalogue& catalogue) {
  std::array<bool, kLongitudes> used{};
  double south = 90, north = -90;
  for (const dem::RasterInfo& raster : catalogue.rasters()) {
    const dem::Footprint& f = raster.footprint;
    south = std::min(south, f.south_deg);
    north = std::max(north, f.north_deg);
    const int west = static_cast<int>(std::floor(f.west_deg + 180 + kInset_deg));
    const int east = static_cast<int>(std::ceil(f.east_deg + 180 - kInset_deg));
    for (int column = west; column < std::min(east, west + kLongitudes); ++column)
      used[static_cast<std::size_t>((column + kLongitudes) % kLongitudes)] = true;
  }
  const auto [west, east] = used_columns(used);
  return {static_cast<int>(std::floor(south + 90 + kInset_deg)), static_cast<int>(std::ceil(north + 90 - kInset_deg)),
          west, east};
}

// Returns true if a file touches the interior of a cell.
bool is_covered(const dem::Catalogue& catalogue, int row, int column) {
  const double south = row - 90.0, west = column - 180.0;
  return !catalogue.touching(south + kInset_deg, south + 1 - kInset_deg, west + kInset_deg, west + 1 - kInset_deg)
              .empty();
}

// Extends the box below a run of holes if both span the same columns; else adds a box.
//
//   row 2  . # # .      two boxes: columns 1 to 2 of rows 1 and 2,
//   row 1  . # # .      and column 3 of row 0
//   row 0  . . . #
void add_run(std::vector<Box>& boxes, const Box& run) {
  for (Box& box : boxes) {
    if (box.north == run.south && box.west == run.west && box.east == run.east) {
      box.north = run.north;
      return;
    }
  }
  boxes.push_back(run);
}

}  // namespace

std::vector<dem::Footprint> uncovered(const dem::Catalogue& catalogue) {
  if (catalogue.rasters().empty()) return {};
  const Box extent = bounds(catalogue);
  std::vector<Box> boxes;
  for (int row = extent.south; row < extent.north; ++row) {
    int run_start = -1;  // first column of the current run of holes; -1: none
    // The column behind the last one is not a hole: it ends a run at the eastern border.
    for (int column = extent.west; column <= extent.east; ++column) {
      const bool is_hole = column < extent.east && !is_covered(catalogue, row, column);
      if (is_hole && run_start < 0) run_start = column;
      if (!is_hole && run_start >= 0) {
        add_run(boxes, {row, row + 1, run_start, column});
        run_start = -1;
      }
    }
  }
  std::vector<dem::Footprint> gaps;
  for (const Box& box : boxes) {
    const double west_deg = box.west % kLongitudes - 180.0;
    gaps.push_back({box.south - 90.0, box.north - 90.0, west_deg, west_deg + (box.east - box.west)});
  }
  return gaps;
}

}  // namespace selenograph::server
