#include "engine/scene/root_groups.h"

#include "dem/grid/lattice.h"

namespace selenograph::engine {
namespace {

constexpr int kRows = 5, kColumns = 18;  // 20 by 20 degrees
// The ball around a block whose heights are known is not quite inside the one around all heights that it might have.
constexpr double kSlack_m = 30000;

void enclose(RootGroup& group) {
  std::vector<NodeBounds> all;
  Vec3 centre = Vec3::Zero();
  for (int row = group.first_row; row < group.past_last_row; ++row) {
    const auto i = static_cast<std::size_t>(row - group.first_row);
    for (int col = group.first_column[i]; col < group.past_last_column[i]; ++col) {
      all.push_back(bounds_of({0, row, col}, static_cast<double>(dem::kLowestRelief_m),
                              static_cast<double>(dem::kHighestRelief_m)));
      centre += all.back().centre;
    }
  }
  centre /= static_cast<double>(all.size());
  double radius_m = 0;
  for (const NodeBounds& b : all) radius_m = std::max(radius_m, (b.centre - centre).norm() + b.radius_m);
  group.bounds = bounds_around(centre, radius_m + kSlack_m);
  group.bounds.high_m = static_cast<double>(dem::kHighestRelief_m);  // the ball reaches higher, what is in it doesn't
}

std::vector<RootGroup> made() {
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
      if (!any) continue;  // next to a pole there are fewer columns
      enclose(group);
      groups.push_back(std::move(group));
    }
  return groups;
}

}  // namespace

const std::vector<RootGroup>& root_groups() {
  static const std::vector<RootGroup> groups = made();
  return groups;
}

}  // namespace selenograph::engine
