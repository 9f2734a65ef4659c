#include "engine/scene/root_groups.h"

#include "dem/grid/lattice.h"

namespace selenograph::engine {
namespace {

constexpr int kRows = 5, kColumns = 18;  // rows of roots per group; groups per row: 20 by 20 degrees
// The sphere around a block of known heights may extend a little beyond the one around all possible heights.
constexpr double kSlack_m = 30000;

// Sets the bounds of a group's blocks at all possible heights.
void enclose(RootGroup& group) {
  std::vector<NodeBounds> block_bounds;
  Vec3 centre = Vec3::zero();
  for (int row = group.first_row; row < group.past_last_row; ++row) {
    const auto i = static_cast<std::size_t>(row - group.first_row);
    for (int col = group.first_column[i]; col < group.past_last_column[i]; ++col) {
      block_bounds.push_back(bounds_of({0, row, col}, static_cast<double>(dem::kLowestRelief_m),
                                       static_cast<double>(dem::kHighestRelief_m)));
      centre += block_bounds.back().centre;
    }
  }
  centre /= static_cast<double>(block_bounds.size());
  double radius_m = 0;
  for (const NodeBounds& b : block_bounds) radius_m = std::max(radius_m, (b.centre - centre).norm() + b.radius_m);
  group.bounds = bounds_around(centre, radius_m + kSlack_m);
  group.bounds.high_m =
      static_cast<double>(dem::kHighestRelief_m);  // the sphere extends higher, but its content does not
}

// Returns the groups of all roots, in rows from the south.
std::vector<RootGroup> make_groups() {
  std::vector<RootGroup> groups;
  const int rows = dem::rows_of(0);
  for (int row = 0; row < rows; row += kRows)
    for (int k = 0; k < kColumns; ++k) {
      RootGroup group{row, std::min(row + kRows, rows), {}, {}, {}};
      bool any = false;
      for (int r = row; r < group.past_last_row; ++r) {
        const int columns = dem::columns_of(0, r);
        group.first_column.push_back(columns * k / kColumns);
        group.past_last_column.push_back(columns * (k + 1) / kColumns);
        any |= group.first_column.back() < group.past_last_column.back();
      }
      if (!any) continue;  // rows next to a pole have fewer columns
      enclose(group);
      groups.push_back(std::move(group));
    }
  return groups;
}

}  // namespace

const std::vector<RootGroup>& root_groups() {
  static const std::vector<RootGroup> groups = make_groups();
  return groups;
}

}  // namespace selenograph::engine
