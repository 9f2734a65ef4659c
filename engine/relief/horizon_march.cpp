#include "engine/relief/horizon_march.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "dem/base/vector_targets.h"
#include "dem/grid/geodesy.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/relief/horizon_march.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "engine/relief/cell_readers.h"
#include "engine/support/lane_angles.h"

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// Tangents at and below this value are not of any ground with data.
inline constexpr float kNoGround = -1e3F;

// Returns the part of a height's rise that a smaller radius of the place leaves: 1 / (1 + h / R), with an error of
// (h / R)^2.
HWY_INLINE Lanes NearOne(Sixteen d, Lanes height, float per_radius) {
  return hn::Sub(hn::Set(d, 1.F), hn::Mul(height, hn::Set(d, per_radius)));
}

HWY_INLINE Lanes Between(Lanes from, Lanes to, Lanes share) { return hn::Add(from, hn::Mul(share, hn::Sub(to, from))); }

// The highest ground of a segment is that of a table's cell for the whole packet or, where its places are far apart for
// the segment's length, of a cell for each lane. Without a table it is the grid's highest post.
struct Bound {
  const HighestPosts* table;
  bool of_lanes;
};

// Means of reading the cells below sixteen places. All give the same heights.
enum class Reader {
  gather,   // post by post
  patch,    // from the 4 x 4 posts that hold all cells
  lattice,  // four adjacent posts at a time: places are on the lattice, see ReliefGrid
};

struct ChosenTables {
  std::vector<Bound> segments, parts;
  Reader near_reader;           // of the samples before the first segment
  std::vector<Reader> readers;  // of the segments
};

// The middle of a packet, and the largest distance of its places from it, in x or y.
struct PacketMiddle {
  float x, y, half_m;
};
PacketMiddle MiddleOf(const MarchPlaces& places) {
  const auto [west, east] = std::minmax_element(std::begin(places.x), std::end(places.x));
  const auto [south, north] = std::minmax_element(std::begin(places.y), std::end(places.y));
  return {(*west + *east) / 2, (*south + *north) / 2, std::max(*east - *west, *north - *south) / 2};
}

// Chooses for each segment its reader and the smallest table that covers it, from anywhere in any of the packets or
// from its lane.
ChosenTables ChooseTables(const MarchPlan& plan, std::span<const MarchPlaces> packets) {
  float spread_m = 0, turn = 0, half_m = 0;
  bool on_lattice = true;
  for (const MarchPlaces& places : packets) {
    half_m = std::max(half_m, MiddleOf(places).half_m);
    on_lattice = on_lattice && places.on_lattice;
    spread_m = std::max(spread_m, places.spread_m);
    turn = std::max(turn, places.turn);
  }
  const auto table_of = [&](const MarchSegment& segment) -> Bound {
    const auto grid = static_cast<std::size_t>(segment.grid);
    constexpr float kFarApart = 0.5F;  // over half the segment's length
    const float apart_m = spread_m + turn * segment.far_m;
    const bool of_lanes = apart_m > kFarApart * segment.half_m;
    // A position reads the posts around it; one more is a margin for rounding.
    const float extent_posts = (segment.half_m + (of_lanes ? 0 : apart_m)) * plan.grids[grid].posts_per_m + 2;
    for (const HighestPosts& table : plan.highest[grid])
      if (table.reach_posts() >= extent_posts) return {&table, of_lanes};
    return {nullptr, false};
  };
  const auto reader_of = [&](int grid_index, float far_m) {
    const ReliefGrid& grid = plan.grids[static_cast<std::size_t>(grid_index)];
    const float turn_posts = turn * far_m * grid.posts_per_m;
    // On the lattice all lanes are read along their mean direction: outer ones are aside by half of this.
    constexpr float kMaxTurn_posts = 0.5F;
    if (grid.has_lattice) return on_lattice && turn_posts < kMaxTurn_posts ? Reader::lattice : Reader::gather;
    constexpr float kMargin_posts = 0.01F;
    const bool in_patch = kLanes >= 8 && half_m * grid.posts_per_m + turn_posts < 1 - kMargin_posts;
    return in_patch ? Reader::patch : Reader::gather;
  };
  ChosenTables tables;
  tables.near_reader =
      reader_of(0, plan.near_samples > 0 ? plan.samples[static_cast<std::size_t>(plan.near_samples) - 1].plane_m : 0);
  for (const MarchSegment& segment : plan.segments) tables.readers.push_back(reader_of(segment.grid, segment.far_m));
  for (const MarchSegment& segment : plan.segments) tables.segments.push_back(table_of(segment));
  for (const MarchSegment& part : plan.parts) tables.parts.push_back(table_of(part));
  return tables;
}

// The march of sixteen places.
class PacketMarch {
 public:
  PacketMarch(const MarchPlan& plan, const ChosenTables& tables, const MarchPlaces& places)
      : plan_(plan), tables_(tables), places_(places), middle_(MiddleOf(places)) {}

  // Finds the horizons at an azimuth, as tangents; kNoGround or less without any ground.
  void find(float cosine, float sine, float* tangent) {
    aim(cosine, sine);
    begin();
    read(plan_.grids.front(), tables_.near_reader, 0, plan_.near_samples);
    // Read the segment of the horizon at the previous azimuth first: it mostly has the horizon again, so that most
    // others are skipped.
    const std::size_t seed = seed_;
    if (seed < plan_.segments.size()) visit(seed);
    for (std::size_t i = 0; i < plan_.segments.size(); ++i)
      if (i != seed && may_rise(plan_.segments[i], tables_.segments[i]) && visit(i)) seed_ = i;
    for (int i = 0; i < kPacket; ++i) tangent[i] = horizon_[i];
  }

 private:
  // Sets the directions of the lanes in the plane.
  void aim(float cosine, float sine) {
    const Sixteen d;
    const Lanes c = hn::Set(d, cosine), s = hn::Set(d, sine);
    const auto turned = [&](const float* north, const float* east, int i, float* out) {
      hn::Store(hn::Add(hn::Mul(c, hn::Load(d, north + i)), hn::Mul(s, hn::Load(d, east + i))), d, out + i);
    };
    for (int i = 0; i < kPacket; i += kLanes) {
      turned(places_.north_x, places_.east_x, i, dx_);
      turned(places_.north_y, places_.east_y, i, dy_);
      turned(places_.north_k, places_.east_k, i, k_);
    }
    constexpr int kLast = kPacket - 1;
    middle_dx_ = (dx_[0] + dx_[kLast]) / 2;
    middle_dy_ = (dy_[0] + dy_[kLast]) / 2;
    middle_k_ = (k_[0] + k_[kLast]) / 2;
  }

  // Sets the horizon at distance 0: the slope of the ground ahead of the place, or none for an eye above the ground.
  void begin() {
    const Sixteen d;
    const ReliefGrid& grid = plan_.grids.front();
    constexpr float kAhead_posts = 1.F / 64;  // selects the cell ahead of a place on a border of cells
    const Lanes scale = hn::Set(d, grid.posts_per_m), middle = hn::Set(d, grid.middle),
                ahead = hn::Set(d, kAhead_posts);
    for (int i = 0; i < kPacket; i += kLanes) {
      const Lanes dx = hn::Load(d, dx_ + i), dy = hn::Load(d, dy_ + i);
      const Lanes column = hn::Add(hn::Add(hn::Mul(hn::Load(d, places_.x + i), scale), middle), hn::Mul(dx, ahead));
      const Lanes row = hn::Add(hn::Add(hn::Mul(hn::Load(d, places_.y + i), scale), middle), hn::Mul(dy, ahead));
      const CellCorners cell = tables_.near_reader == Reader::lattice
                                   ? LatticeCells(d, grid, lattice_column(grid) + middle_dx_ * kAhead_posts,
                                                  lattice_row(grid) + middle_dy_ * kAhead_posts, i)
                                   : GatherCells(d, grid, column, row);
      const Lanes eastward =
          Between(hn::Sub(cell.south_east, cell.south_west), hn::Sub(cell.north_east, cell.north_west), cell.north);
      const Lanes northward =
          Between(hn::Sub(cell.north_west, cell.south_west), hn::Sub(cell.north_east, cell.south_east), cell.east);
      const Lanes slope = hn::Mul(hn::Add(hn::Mul(eastward, dx), hn::Mul(northward, dy)), scale);
      const Lanes height = hn::Load(d, places_.height + i);
      const Lanes tangent =
          hn::Mul(hn::Mul(slope, hn::Set(d, plan_.radius_ratio)), NearOne(d, height, plan_.per_radius));
      const Lanes none = hn::Set(d, kNoGround);
      hn::Store(places_.on_ground ? hn::Max(tangent, none) : none, d, horizon_ + i);
    }
    // An infinite horizon makes all segments irrelevant to an invalid lane.
    for (int i = 0; i < kPacket; ++i)
      if (!places_.valid[i]) horizon_[i] = std::numeric_limits<float>::infinity();
  }

  // Returns the position in a grid of lane 0 on the lattice.
  static float on_post(float x_m, const ReliefGrid& grid) { return std::round(x_m * grid.posts_per_m + grid.middle); }
  float lattice_column(const ReliefGrid& grid) const { return on_post(places_.x[0], grid); }
  float lattice_row(const ReliefGrid& grid) const { return on_post(places_.y[0], grid); }

  // Raises the horizons to samples of a grid. Returns true if any lane's rose.
  bool read(const ReliefGrid& grid, Reader reader, int first, int past_last) {
    switch (reader) {
      case Reader::lattice:
        return read_on_lattice(grid, first, past_last);
      case Reader::patch:
        return read_at_lanes<true>(grid, first, past_last);
      case Reader::gather:
        break;
    }
    return read_at_lanes<false>(grid, first, past_last);
  }

  // Returns the distance in the plane of a sample along a direction with this k. 1 / (1 + w) is a series: w is at most
  // 0.002.
  static float distance_m(const MarchSample& sample, float k) {
    const float w = k * sample.tan_angle;
    return sample.plane_m * (1 - w * (1 - w));
  }
  HWY_INLINE Lanes TangentOf(Sixteen d, const CellCorners& cell, const MarchSample& sample, Lanes own_height) const {
    const Lanes south = Between(cell.south_west, cell.south_east, cell.east);
    const Lanes north = Between(cell.north_west, cell.north_east, cell.east);
    const Lanes height = Between(south, north, cell.north);
    const Lanes rise = hn::Mul(hn::Sub(height, own_height), NearOne(d, height, plan_.per_radius));
    return hn::Sub(hn::Mul(rise, hn::Set(d, sample.rise_per_m)), hn::Set(d, sample.drop));
  }
  // Stores horizons from lane `i` on. Returns true if any of them rose.
  bool raise(Sixteen d, Lanes horizon, int i) {
    const bool rose = !hn::AllFalse(d, hn::Gt(horizon, hn::Load(d, horizon_ + i)));
    hn::Store(horizon, d, horizon_ + i);
    return rose;
  }

  bool read_on_lattice(const ReliefGrid& grid, int first, int past_last) {
    const Sixteen d;
    const float column = lattice_column(grid), row = lattice_row(grid);
    const float columns_per_m = middle_dx_ * grid.posts_per_m, rows_per_m = middle_dy_ * grid.posts_per_m;
    bool rose = false;
    for (int i = 0; i < kPacket; i += kLanes) {
      const Lanes own_height = hn::Load(d, places_.height + i);
      Lanes horizon = hn::Load(d, horizon_ + i);
      for (int j = first; j < past_last; ++j) {
        const MarchSample& sample = plan_.samples[static_cast<std::size_t>(j)];
        const float distance = distance_m(sample, middle_k_);
        const CellCorners cell =
            LatticeCells(d, grid, column + columns_per_m * distance, row + rows_per_m * distance, i);
        horizon = hn::Max(horizon, TangentOf(d, cell, sample, own_height));
      }
      rose = raise(d, horizon, i) || rose;
    }
    return rose;
  }

  template <bool kPatch>
  bool read_at_lanes(const ReliefGrid& grid, int first, int past_last) {
    const Sixteen d;
    const Lanes scale = hn::Set(d, grid.posts_per_m), middle = hn::Set(d, grid.middle), unity = hn::Set(d, 1.F);
    bool rose = false;
    for (int i = 0; i < kPacket; i += kLanes) {
      const Lanes column = hn::Add(hn::Mul(hn::Load(d, places_.x + i), scale), middle);
      const Lanes row = hn::Add(hn::Mul(hn::Load(d, places_.y + i), scale), middle);
      const Lanes columns_per_m = hn::Mul(hn::Load(d, dx_ + i), scale);
      const Lanes rows_per_m = hn::Mul(hn::Load(d, dy_ + i), scale);
      const Lanes k = hn::Load(d, k_ + i), own_height = hn::Load(d, places_.height + i);
      Lanes horizon = hn::Load(d, horizon_ + i);
      for (int j = first; j < past_last; ++j) {
        const MarchSample& sample = plan_.samples[static_cast<std::size_t>(j)];
        const Lanes w = hn::Mul(k, hn::Set(d, sample.tan_angle));
        const Lanes distance = hn::Mul(hn::Set(d, sample.plane_m), hn::Sub(unity, hn::Mul(w, hn::Sub(unity, w))));
        const Lanes columns = hn::Add(column, hn::Mul(columns_per_m, distance));
        const Lanes rows = hn::Add(row, hn::Mul(rows_per_m, distance));
        if constexpr (kPatch) {
          const float from_middle = distance_m(sample, middle_k_);
          const auto first_post = [&](float at_m, float direction) {
            return static_cast<int>((at_m + direction * from_middle) * grid.posts_per_m + grid.middle) - 1;
          };
          horizon = hn::Max(horizon, TangentOf(d,
                                               PatchCells(d, grid, columns, rows, first_post(middle_.x, middle_dx_),
                                                          first_post(middle_.y, middle_dy_)),
                                               sample, own_height));
        } else {
          horizon = hn::Max(horizon, TangentOf(d, GatherCells(d, grid, columns, rows), sample, own_height));
        }
      }
      rose = raise(d, horizon, i) || rose;
    }
    return rose;
  }

  // Returns the index of the table's cell around the middle of a segment, as the first lane sees it.
  std::size_t first_cell(const MarchSegment& segment, const ReliefGrid& grid, const HighestPosts& table) const {
    const float w = k_[0] * segment.tan_middle, distance = segment.middle_m * (1 - w * (1 - w));
    const float column = (places_.x[0] + dx_[0] * distance) * grid.posts_per_m + grid.middle;
    const float row = (places_.y[0] + dy_[0] * distance) * grid.posts_per_m + grid.middle;
    const int i = static_cast<int>(column) >> table.cell_log2, j = static_cast<int>(row) >> table.cell_log2;
    return static_cast<std::size_t>(j) * static_cast<std::size_t>(table.side) + static_cast<std::size_t>(i);
  }
  // Returns the values of the cells around the middle of a segment, as each lane from `i` on sees it.
  HWY_INLINE Lanes TopsOfLanes(const MarchSegment& segment, const ReliefGrid& grid, const HighestPosts& table,
                               int i) const {
    const Sixteen d;
    const hn::Rebind<std::int32_t, Sixteen> di;
    const Lanes unity = hn::Set(d, 1.F), scale = hn::Set(d, grid.posts_per_m), middle = hn::Set(d, grid.middle);
    const Lanes w = hn::Mul(hn::Load(d, k_ + i), hn::Set(d, segment.tan_middle));
    const Lanes distance = hn::Mul(hn::Set(d, segment.middle_m), hn::Sub(unity, hn::Mul(w, hn::Sub(unity, w))));
    const auto cell_at = [&](const float* from, const float* step) {
      const Lanes at = hn::Add(hn::Load(d, from + i), hn::Mul(hn::Load(d, step + i), distance));
      return hn::ShiftRightSame(hn::ConvertTo(di, hn::Add(hn::Mul(at, scale), middle)), table.cell_log2);
    };
    const auto column = cell_at(places_.x, dx_), row = cell_at(places_.y, dy_);
    return hn::GatherIndex(d, table.heights.data(), hn::Add(hn::Mul(row, hn::Set(di, table.side)), column));
  }

  // Returns true if ground of a segment may be above any lane's horizon by more than the tolerance.
  bool may_rise(const MarchSegment& segment, const Bound& bound) const {
    const ReliefGrid& grid = plan_.grids[static_cast<std::size_t>(segment.grid)];
    float top = grid.highest_m;
    if (bound.table && !bound.of_lanes) top = bound.table->heights[first_cell(segment, grid, *bound.table)];
    const Sixteen d;
    const Lanes at_near = hn::Set(d, segment.near_rise_per_m), at_far = hn::Set(d, segment.far_rise_per_m);
    constexpr auto kTolerance = static_cast<float>(kHorizonTolerance_deg * kRadiansPerDegree);
    const Lanes to_exceed = hn::Set(d, segment.near_drop + kTolerance);
    return AnyLane([&](int i) {
      const Lanes highest = bound.of_lanes ? TopsOfLanes(segment, grid, *bound.table, i) : hn::Set(d, top);
      const Lanes rise =
          hn::Mul(hn::Sub(highest, hn::Load(d, places_.height + i)), NearOne(d, highest, plan_.per_radius));
      const Lanes tangent = hn::Sub(hn::Max(hn::Mul(rise, at_near), hn::Mul(rise, at_far)), to_exceed);
      return hn::Gt(tangent, hn::Load(d, horizon_ + i));
    });
  }

  // Reads a segment, or those of its parts that may rise. Returns true if any lane's horizon rose.
  bool visit(std::size_t index) {
    const MarchSegment& segment = plan_.segments[index];
    const ReliefGrid& grid = plan_.grids[static_cast<std::size_t>(segment.grid)];
    if (segment.first_part == segment.past_last_part)
      return read(grid, tables_.readers[index], segment.first, segment.past_last);
    bool rose = false;
    for (int i = segment.first_part; i < segment.past_last_part; ++i) {
      const auto part_index = static_cast<std::size_t>(i);
      const MarchSegment& short_segment = plan_.parts[part_index];
      if (may_rise(short_segment, tables_.parts[part_index]))
        rose = read(grid, tables_.readers[index], short_segment.first, short_segment.past_last) || rose;
    }
    return rose;
  }

  const MarchPlan& plan_;
  const ChosenTables& tables_;
  const MarchPlaces& places_;
  PacketMiddle middle_;
  float middle_dx_ = 0, middle_dy_ = 0, middle_k_ = 0;
  std::size_t seed_ = 0;
  alignas(64) float dx_[kPacket];
  alignas(64) float dy_[kPacket];
  alignas(64) float k_[kPacket];
  alignas(64) float horizon_[kPacket];  // tangents
};

// Writes elevations in degrees for tangents.
void WriteElevations(const float* tangent, float* elevation_deg) {
  const Sixteen d;
  const Lanes degrees = hn::Set(d, static_cast<float>(kDegreesPerRadian));
  const Lanes nothing = hn::Set(d, std::numeric_limits<float>::quiet_NaN());
  const Lanes no_ground = hn::Set(d, kNoGround), infinite = hn::Set(d, 1e30F);
  for (int i = 0; i < kPacket; i += kLanes) {
    const Lanes t = hn::Load(d, tangent + i);
    const auto is_ground = hn::And(hn::Gt(t, no_ground), hn::Lt(t, infinite));
    hn::StoreU(hn::IfThenElse(is_ground, hn::Mul(Arctangent(d, t), degrees), nothing), d, elevation_deg + i);
  }
}

// Implements find_horizons().
void FindHorizons(const MarchPlan& plan, std::span<const MarchPlaces> packets, int azimuths, float* elevation_deg) {
  const ChosenTables tables = ChooseTables(plan, packets);
  std::vector<PacketMarch> marches;
  marches.reserve(packets.size());
  for (const MarchPlaces& places : packets) marches.emplace_back(plan, tables, places);
  alignas(64) float tangent[kPacket];
  for (int azimuth = 0; azimuth < azimuths; ++azimuth) {
    const double azimuth_rad = 2 * std::numbers::pi * azimuth / azimuths;
    const auto cosine = static_cast<float>(std::cos(azimuth_rad)), sine = static_cast<float>(std::sin(azimuth_rad));
    for (std::size_t i = 0; i < marches.size(); ++i) {
      marches[i].find(cosine, sine, tangent);
      const std::size_t row = i * static_cast<std::size_t>(azimuths) + static_cast<std::size_t>(azimuth);
      WriteElevations(tangent, elevation_deg + row * kPacket);
    }
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(FindHorizons);

void find_horizons(const MarchPlan& plan, std::span<const MarchPlaces> packets, int azimuths, float* elevation_deg) {
  HWY_DYNAMIC_DISPATCH(FindHorizons)(plan, packets, azimuths, elevation_deg);
}

}  // namespace selenograph::engine
#endif
