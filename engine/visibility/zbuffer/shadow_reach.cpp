#include "engine/visibility/zbuffer/shadow_reach.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/base/vector_targets.h"
#include "engine/support/packet.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/visibility/zbuffer/shadow_reach.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SELENOGRAPH_ENGINE_REACH_CELLS
#define SELENOGRAPH_ENGINE_REACH_CELLS
namespace selenograph::engine {

struct ReachCells {
  float u0, v0, per_u, per_v;
  int columns, rows;
  const float* top_m;
};

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Tests groups of samples as ShadowReach::find_reached() says: a group is reached unless each sample is above all
// occluders of its cell.
void FindReached(const ReachCells& cells, const float* u, const float* v, const float* d, std::size_t groups,
                 std::uint8_t* reached) {
  const float u0 = cells.u0;
  const float v0 = cells.v0;
  const float per_u = cells.per_u;
  const float per_v = cells.per_v;
  const auto last_column = static_cast<float>(cells.columns - 1);
  const auto last_row = static_cast<float>(cells.rows - 1);
  const int columns = cells.columns;
  for (std::size_t g = 0; g < groups; ++g, u += kPacket, v += kPacket, d += kPacket) {
    alignas(64) std::int32_t cell[kPacket];
    SELENOGRAPH_INDEPENDENT_LANES
    for (int i = 0; i < kPacket; ++i) {
      float column = (u[i] - u0) * per_u;
      float row = (v[i] - v0) * per_v;
      column = column > 0 ? column : 0;
      row = row > 0 ? row : 0;
      column = column < last_column ? column : last_column;
      row = row < last_row ? row : last_row;
      cell[i] = static_cast<std::int32_t>(row) * columns + static_cast<std::int32_t>(column);
    }
    int reached_any = 0;
    for (int i = 0; i < kPacket; ++i) reached_any |= d[i] > cells.top_m[cell[i]] ? 0 : 1;
    reached[g] = static_cast<std::uint8_t>(reached_any);
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(FindReached);

ShadowReach::ShadowReach(float u0, float v0, float per_u, float per_v, int columns, int rows)
    : u0_(u0), v0_(v0), per_u_(per_u), per_v_(per_v), columns_(std::max(columns, 1)), rows_(std::max(rows, 1)) {
  top_m_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_),
                -std::numeric_limits<float>::infinity());
}

void ShadowReach::add(const LightBox& occluder) {
  // Add a cell on either side: far more than the rounding error of coordinates.
  const auto cell = [](float at, float origin, float per_m, int margin, int cells) {
    const float index = std::floor((at - origin) * per_m) + static_cast<float>(margin);
    return static_cast<int>(std::clamp(index, 0.F, static_cast<float>(cells - 1)));
  };
  const int left = cell(occluder.u_low, u0_, per_u_, -1, columns_);
  const int right = cell(occluder.u_high, u0_, per_u_, 1, columns_);
  const int low = cell(occluder.v_low, v0_, per_v_, -1, rows_);
  const int high = cell(occluder.v_high, v0_, per_v_, 1, rows_);
  for (int row = low; row <= high; ++row) {
    float* top_m = top_m_.data() + static_cast<std::ptrdiff_t>(row) * columns_;
    for (int column = left; column <= right; ++column) top_m[column] = std::max(top_m[column], occluder.d_high);
  }
}

void ShadowReach::find_reached(const float* u, const float* v, const float* d, std::size_t groups,
                               std::uint8_t* reached) const {
  HWY_DYNAMIC_DISPATCH(FindReached)
  ({u0_, v0_, per_u_, per_v_, columns_, rows_, top_m_.data()}, u, v, d, groups, reached);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
