// Ways to read the cells of a relief's grid below sixteen places. Which one is fastest, the places decide:
//
//    o o o o o o ..    RowColumns: a row of places, at cells that are a power of two apart
//
//    o o o o           LatticeCells: 4 x 4 places on the grid's lattice, at cells as far apart as they are
//    o o o o           PatchCells: 4 x 4 places on a grid of which 4 x 4 posts hold all their cells
//    o o o o           GatherCells: places anywhere, post by post
//    o o o o
//
// For files that Highway compiles once per width (dem/base/vector_targets.h): include it after hwy/highway.h, outside
// of any namespace.
#if defined(SELENOGRAPH_ENGINE_RELIEF_CELL_READERS_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SELENOGRAPH_ENGINE_RELIEF_CELL_READERS_H_
#undef SELENOGRAPH_ENGINE_RELIEF_CELL_READERS_H_
#else
#define SELENOGRAPH_ENGINE_RELIEF_CELL_READERS_H_
#endif

#include <hwy/highway.h>

#include <cstddef>
#include <cstdint>

#include "engine/relief/relief.h"

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using Sixteen = hn::CappedTag<float, kPacket>;
using Lanes = hn::Vec<Sixteen>;
inline constexpr int kLanes = static_cast<int>(HWY_MIN(HWY_LANES(float), kPacket));

// Returns true if any lane is in the mask that mask_of(first lane) returns for each vector of lanes. Write such loops
// with vectors: compilers do not vectorise reductions.
template <class MaskOf>
HWY_INLINE bool AnyLane(const MaskOf& mask_of) {
  const Sixteen d;
  for (int i = 0; i < kPacket; i += kLanes)
    if (!hn::AllFalse(d, mask_of(i))) return true;
  return false;
}

// Cells of a grid that sixteen points in a row reach at equal distance: one row, columns `column + i * pitch`.
struct RowOfCells {
  int row;
  float column, pitch;  // pitch: columns from lane to lane, 4, 2, 1, 1/2 ...
  float north;          // share of the way to the next row, 0 to 1
};

// Loads the posts west and east of each lane from a row of a grid, one vector of lanes from `first_lane` on. Lanes are
// `pitch` columns apart: below 1 several share a column, and a table lookup spreads the loaded posts; 1 is a plain
// load; 2 and 4 are interleaved loads.
template <class D>
class RowColumns {
 public:
  using V = hn::Vec<D>;
  HWY_INLINE RowColumns(D d, const RowOfCells& cells, int first_lane) : pitch_(cells.pitch) {
    const float first_column = cells.column + static_cast<float>(first_lane) * cells.pitch;
    base_column_ = static_cast<int>(first_column);
    if (pitch_ >= 1) {
      east_share_ = hn::Set(d, first_column - static_cast<float>(base_column_));
      lane_column_ = hn::Zero(di_);
      return;
    }
    const auto position = hn::Add(hn::Set(d, first_column), hn::Mul(hn::Iota(d, 0.F), hn::Set(d, pitch_)));
    const auto column = hn::ConvertTo(di_, position);
    lane_column_ = hn::Sub(column, hn::Set(di_, base_column_));
    east_share_ = hn::Sub(position, hn::ConvertTo(d, column));
    column_count_ = static_cast<int>(first_column + static_cast<float>(kLanes - 1) * pitch_) - base_column_ + 1;
  }
  // Returns the value west of each lane. Below pitch 1 the load is masked to the cells that lanes need: the cells
  // beyond may not be lit yet.
  HWY_INLINE V west(D d, const float* row) const {
    if (pitch_ < 1)
      return hn::TableLookupLanes(
          hn::MaskedLoad(hn::FirstN(d, static_cast<std::size_t>(column_count_)), d, row + base_column_),
          hn::IndicesFromVec(d, lane_column_));
    return load_pair(d, row).west;
  }
  // Interpolates each lane's height between four posts. `north`: share of the way from the south row to the north row.
  HWY_INLINE V height_between(D d, const float* south_row, const float* north_row, V north) const {
    const auto northward = [&](V south_value, V north_value) {
      return hn::Add(south_value, hn::Mul(north, hn::Sub(north_value, south_value)));
    };
    if (pitch_ < 1) {
      // Interpolate columns first: there are fewer of them than lanes.
      const V posts = northward(hn::LoadU(d, south_row + base_column_), hn::LoadU(d, north_row + base_column_));
      const V west = hn::TableLookupLanes(posts, hn::IndicesFromVec(d, lane_column_)),
              east = hn::TableLookupLanes(posts, hn::IndicesFromVec(d, hn::Add(lane_column_, hn::Set(di_, 1))));
      return hn::Add(west, hn::Mul(east_share_, hn::Sub(east, west)));
    }
    const Pair s = load_pair(d, south_row), n = load_pair(d, north_row);
    const V west = northward(s.west, n.west), east = northward(s.east, n.east);
    return hn::Add(west, hn::Mul(east_share_, hn::Sub(east, west)));
  }

 private:
  struct Pair {
    V west, east;
  };
  // Loads the posts of lanes that are at least a column apart.
  HWY_INLINE Pair load_pair(D d, const float* row) const {
    Pair pair{hn::Zero(d), hn::Zero(d)};
    if (pitch_ == 1) {
      pair.west = hn::LoadU(d, row + base_column_);
      pair.east = hn::LoadU(d, row + base_column_ + 1);
    } else if (pitch_ == 2) {
      hn::LoadInterleaved2(d, row + base_column_, pair.west, pair.east);
    } else {
      V unused_third, unused_fourth;
      hn::LoadInterleaved4(d, row + base_column_, pair.west, pair.east, unused_third, unused_fourth);
    }
    return pair;
  }

  const hn::Rebind<std::int32_t, D> di_{};
  float pitch_;                                       // columns from lane to lane
  int base_column_;                                   // column of the first lane's western post
  int column_count_ = kLanes;                         // columns with a lane's western post; only for a pitch below 1
  hn::Vec<hn::Rebind<std::int32_t, D>> lane_column_;  // column of each lane's western post, from base_column_ on
  V east_share_;                                      // share of the way from the western to the eastern post
};

// Four posts around each lane's position in a grid, and the lane's share of the way to the eastern and northern ones.
struct CellCorners {
  Lanes south_west, south_east, north_west, north_east;
  Lanes east, north;
};

// Reads the cells of positions anywhere in a grid, post by post.
HWY_INLINE CellCorners GatherCells(Sixteen d, const ReliefGrid& grid, Lanes column, Lanes row) {
  const hn::Rebind<std::int32_t, Sixteen> di;
  const auto whole_column = hn::ConvertTo(di, column), whole_row = hn::ConvertTo(di, row);
  const auto line = hn::Mul(whole_row, hn::Set(di, grid.pitch));
  const auto post_of = [&](hn::Vec<decltype(di)> c) {
    const auto remainder = hn::And(c, hn::Set(di, (1 << grid.columns_log2) - 1));
    return hn::Add(hn::Add(line, hn::Mul(remainder, hn::Set(di, grid.run))), hn::ShiftRightSame(c, grid.columns_log2));
  };
  const auto west = post_of(whole_column), east = post_of(hn::Add(whole_column, hn::Set(di, 1)));
  const float* north_row = grid.heights.data() + grid.pitch;
  return {hn::GatherIndex(d, grid.heights.data(), west),
          hn::GatherIndex(d, grid.heights.data(), east),
          hn::GatherIndex(d, north_row, west),
          hn::GatherIndex(d, north_row, east),
          hn::Sub(column, hn::ConvertTo(d, whole_column)),
          hn::Sub(row, hn::ConvertTo(d, whole_row))};
}

// Loads rows of four lanes, `step` posts apart.
template <class D>
HWY_INLINE hn::Vec<D> LoadRowsOfFour(D d, const float* first, [[maybe_unused]] std::ptrdiff_t step) {
#if HWY_TARGET != HWY_SCALAR  // which has no Combine()
  if constexpr (constexpr auto kCount = static_cast<std::ptrdiff_t>(hn::MaxLanes(D())); kCount > 4) {
    const hn::Half<D> half;
    return hn::Combine(d, LoadRowsOfFour(half, first + kCount / 8 * step, step), LoadRowsOfFour(half, first, step));
  } else
#endif
    return hn::LoadU(d, first);
}

// Reads the cells of places on the lattice, given by the position of lane 0, for the lanes from `i` on.
HWY_INLINE CellCorners LatticeCells(Sixteen d, const ReliefGrid& grid, float column, float row, int i) {
  const int whole_column = static_cast<int>(column), whole_row = static_cast<int>(row);
  const int mask = (1 << grid.columns_log2) - 1;
  const float* line = grid.heights.data() + static_cast<std::ptrdiff_t>(whole_row) * grid.pitch;
  const auto post_of = [&](int c) { return line + (c & mask) * grid.run + (c >> grid.columns_log2); };
  const float *west = post_of(whole_column), *east = post_of(whole_column + 1);
  // Lanes are in rows of four, the next row south of the one before.
  const std::ptrdiff_t step = -(static_cast<std::ptrdiff_t>(grid.pitch) << grid.columns_log2);
  const std::ptrdiff_t offset = i / 4 * step + i % 4;
  return {LoadRowsOfFour(d, west + offset, step),
          LoadRowsOfFour(d, east + offset, step),
          LoadRowsOfFour(d, west + grid.pitch + offset, step),
          LoadRowsOfFour(d, east + grid.pitch + offset, step),
          hn::Set(d, column - static_cast<float>(whole_column)),
          hn::Set(d, row - static_cast<float>(whole_row))};
}

// Looks lanes up in 4 x 4 posts, given by the index of each lane's post.
template <class D, class I>
HWY_INLINE hn::Vec<D> LookUp(D d, const float* posts, std::ptrdiff_t pitch, I index) {
  const auto low = LoadRowsOfFour(d, posts, pitch);
  if constexpr (hn::MaxLanes(D()) == 16) {
    return hn::TableLookupLanes(low, hn::IndicesFromVec(d, index));
  } else {
    const hn::Rebind<std::int32_t, D> di;
    const auto last = hn::Set(di, static_cast<int>(hn::MaxLanes(d)) - 1);
    const auto index_in_half = hn::IndicesFromVec(d, hn::And(index, last));
    const auto high = LoadRowsOfFour(d, posts + hn::MaxLanes(d) / 4 * pitch, pitch);
    return hn::IfThenElse(hn::RebindMask(d, hn::Gt(index, last)), hn::TableLookupLanes(high, index_in_half),
                          hn::TableLookupLanes(low, index_in_half));
  }
}

// Reads the cells of positions within 4 x 4 posts, the south-western one of which is at `first_column`, `first_row`.
HWY_INLINE CellCorners PatchCells(Sixteen d, const ReliefGrid& grid, Lanes column, Lanes row, int first_column,
                                  int first_row) {
  const hn::Rebind<std::int32_t, Sixteen> di;
  const auto whole_column = hn::ConvertTo(di, column), whole_row = hn::ConvertTo(di, row);
  const auto post = hn::Add(hn::ShiftLeft<2>(hn::Sub(whole_row, hn::Set(di, first_row))),
                            hn::Sub(whole_column, hn::Set(di, first_column)));
  const float* posts = grid.heights.data() + static_cast<std::ptrdiff_t>(first_row) * grid.pitch + first_column;
  const auto corner = [&](int offset) { return LookUp(d, posts, grid.pitch, hn::Add(post, hn::Set(di, offset))); };
  return {corner(0),
          corner(1),
          corner(4),
          corner(5),
          hn::Sub(column, hn::ConvertTo(d, whole_column)),
          hn::Sub(row, hn::ConvertTo(d, whole_row))};
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
