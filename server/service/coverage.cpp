#include "server/service/coverage.h"

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

Box bounds(const dem::Catalogue& catalogue) {
  std::array<bool, kLongitudes> used{};
  double south = 90, north = -90;
  for (const dem::RasterInfo& raster : catalogue.rasters()) {
    const dem::Footprint& f = raster.footprint;
    south = std::min(south, f.south_deg);
    north = std::max(north, f.north_deg);
    const int west = static_cast<int>(std::floor(f.west_deg + 180 + kInset_deg));
    const int east = static_cast<int>(std::ceil(f.east_deg + 180 - kInset_deg));
    for (int c = west; c < std::min(east, west + kLongitudes); ++c)
      used[static_cast<std::size_t>((c + kLongitudes) % kLongitudes)] = true;
  }
  const auto [west, east] = used_columns(used);
  return {static_cast<int>(std::floor(south + 90 + kInset_deg)), static_cast<int>(std::ceil(north + 90 - kInset_deg)),
          west, east};
}

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
    int start = -1;
    for (int column = extent.west; column <= extent.east; ++column) {
      const bool hole = column < extent.east && !is_covered(catalogue, row, column);
      if (hole && start < 0) start = column;
      if (!hole && start >= 0) {
        add_run(boxes, {row, row + 1, start, column});
        start = -1;
      }
    }
  }
  std::vector<dem::Footprint> out;
  for (const Box& box : boxes) {
    const double west = box.west % kLongitudes - 180.0;
    out.push_back({box.south - 90.0, box.north - 90.0, west, west + (box.east - box.west)});
  }
  return out;
}

}  // namespace selenograph::server
