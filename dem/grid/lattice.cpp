#include "dem/grid/lattice.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "dem/grid/geodesy.h"

namespace selenograph::dem {
namespace {

constexpr int kBlockQuads = 64;

}  // namespace

std::string to_string(const BlockId& id) { return fmt::format("L{:02} r{} c{}", id.level, id.row, id.col); }

int quads_per_side(int level) { return level >= kRootLevel ? kBlockQuads : kBlockQuads >> (kRootLevel - level); }

int rows_of(int level) { return static_cast<int>(kLatTicks / (quads_per_side(level) * lat_step_of(level))); }

// Doubles the step while quads, at the row's edge nearest to the equator, stay at most half as wide as high.
int lon_shift(int level, int row) {
  const Tick side = quads_per_side(level) * lat_step_of(level);
  const double south = std::abs(lat_deg_of(row * side)), north = std::abs(lat_deg_of((row + 1) * side));
  const double equatorward_deg =
      (row * side <= kLatTicks / 2 && (row + 1) * side >= kLatTicks / 2) ? 0 : std::min(south, north);
  // Return early where cos > 1/4: this function is called for every block of every frame.
  if (equatorward_deg < 75) return 0;
  const double aspect = std::cos(equatorward_deg * kRadiansPerDegree);
  const int max_shift = std::max(0, level - kRootLevel) + 1;  // blocks of 8 degrees: 45 around the globe
  int shift = 0;
  while (shift < max_shift && std::ldexp(aspect, shift + 1) <= 0.5) ++shift;
  return shift;
}

int columns_of(int level, int row) {
  return static_cast<int>(kLonTicks / ((quads_per_side(level) * lat_step_of(level)) << lon_shift(level, row)));
}

BlockExtent extent_of(const BlockId& id) {
  const int quads = quads_per_side(id.level);
  const Tick lat_step = lat_step_of(id.level), lon_step = lat_step << lon_shift(id.level, id.row);
  return {id.row * (quads * lat_step), id.col * (quads * lon_step), lat_step, lon_step, quads};
}

// A child row with a larger longitude shift than its parent's has one child, else two.
std::vector<BlockId> children_of(const BlockId& id) {
  if (id.level < kRootLevel) return {{id.level + 1, id.row, id.col}};
  const BlockExtent e = extent_of(id);
  std::vector<BlockId> children;
  for (int row = 2 * id.row; row <= 2 * id.row + 1; ++row) {
    const BlockId first = block_at(id.level + 1, row * (e.quads * e.lat_step / 2), e.lon0);
    const BlockExtent c = extent_of(first);
    for (int i = 0; i < (e.lon1() - e.lon0) / (c.lon1() - c.lon0); ++i)
      children.push_back({first.level, first.row, first.col + i});
  }
  return children;
}

BlockId ancestor_of(const BlockId& id, int level) {
  const BlockExtent e = extent_of(id);
  return block_at(level, e.lat0, e.lon0);
}

BlockId block_at(int level, Tick lat_tick, Tick lon_tick) {
  const Tick side = quads_per_side(level) * lat_step_of(level);
  const int row = std::min(static_cast<int>(lat_tick / side), rows_of(level) - 1);
  return {level, row, static_cast<int>(lon_tick / (side << lon_shift(level, row)))};
}

Tick wrap_lon(Tick lon_tick) {
  const Tick wrapped = lon_tick % kLonTicks;
  return wrapped < 0 ? wrapped + kLonTicks : wrapped;
}

double post_spacing_m(int level) { return kMetresPerDegree / static_cast<double>(std::int64_t{1} << level); }

double chord_sag_m(int level) {
  const double half_diagonal = post_spacing_m(level) / std::numbers::sqrt2;
  return half_diagonal * half_diagonal / (2 * kMoonRadius_m);
}

double parallel_shift_m(const BlockId& id) {
  const BlockExtent e = extent_of(id);
  const double south = std::abs(lat_deg_of(e.lat0)), north = std::abs(lat_deg_of(e.lat1()));
  const double equatorward = std::min(south, north) * kRadiansPerDegree,
               poleward = std::max(south, north) * kRadiansPerDegree,
               half_step = static_cast<double>(e.lon_step) / kTicksPerDegree / 2 * kRadiansPerDegree;
  // A chord lies nearer to the axis than its parallel. The offset has a component downward, the sag, and one toward the
  // pole, this shift:
  //
  //        axis |        o parallel
  //             |  <--- o  chord's middle, nearer to the axis by R cos(lat) (1 - cos(half_step))
  //             |      the component along the meridian is that times sin(lat)
  return kMoonRadius_m * std::cos(equatorward) * (1 - std::cos(half_step)) * std::sin(poleward);
}

}  // namespace selenograph::dem
