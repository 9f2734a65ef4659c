#include "dem/terrain/finest_edges.h"

#include <algorithm>
#include <optional>

namespace selenograph::dem {
namespace {

std::pair<int, int> group(int i, int stride) { return {i - i % stride, i - i % stride + stride}; }

}  // namespace

FinestEdges::FinestEdges(const Terrain& terrain, const Block& block, const Quads& quads, const StopToken& stop)
    : block_(block) {
  const BlockExtent& e = block.extent;
  std::optional<int> posts;
  const auto edge = [&](std::int64_t lat, std::int64_t lon, bool along_lon) -> Edge {
    if (lat < 0 || lat >= kLatTicks) return {};
    if (!posts) posts = terrain.plain().posts_level(block.id);
    const auto at = [&](int level) { return block_at(level, static_cast<std::int32_t>(lat), wrap_lon(lon)); };
    const BlockId probe = at(kMaxLevel), across = at(std::min(terrain.finest_level(probe), block.id.level));
    const bool coarser_posts = terrain.plain().posts_level(probe) < *posts;
    const BlockExtent other = extent_of(across);
    const int stride = along_lon ? other.lon_step / e.lon_step : other.lat_step / e.lat_step;
    if (!coarser_posts && stride <= 1) return {};
    std::shared_ptr<const Block> neighbour = terrain.block(across, stop);
    if (!neighbour) return {};
    return {std::clamp(stride, 1, e.quads), coarser_posts ? std::move(neighbour) : nullptr};
  };
  if (quads.first_row == 0) south_ = edge(std::int64_t{e.lat0} - 1, e.lon0, true);
  if (quads.last_row == e.quads - 1) north_ = edge(e.lat1(), e.lon0, true);
  if (quads.first_column == 0) west_ = edge(e.lat0, std::int64_t{e.lon0} - 1, false);
  if (quads.last_column == e.quads - 1) east_ = edge(e.lat0, e.lon1(), false);
}

Vec3 FinestEdges::vertex(int r, int c) const {
  const int quads = block_.extent.quads;
  const Edge none;
  const Edge& across = r == 0 ? south_ : r == quads ? north_ : none;
  const Edge& beside = c == 0 ? west_ : c == quads ? east_ : none;
  const int at_r = r - r % beside.stride, at_c = c - c % across.stride;
  float height_m = block_.vertices[block_.index(at_r, at_c)].height_m;
  for (const Edge* edge : {&across, &beside})
    if (edge->coarser) {
      const std::int64_t lat = block_.extent.lat0 + std::int64_t{at_r} * block_.extent.lat_step,
                         lon = block_.extent.lon0 + std::int64_t{at_c} * block_.extent.lon_step;
      height_m = post_at(*edge->coarser, lat, lon).value_or(height_m);
    }
  return block_.position(at_r, at_c, static_cast<double>(height_m));
}

std::pair<int, int> FinestEdges::rows(int r, int c) const {
  return group(r, c == 0 ? west_.stride : c == block_.extent.quads - 1 ? east_.stride : 1);
}
std::pair<int, int> FinestEdges::columns(int r, int c) const {
  return group(c, r == 0 ? south_.stride : r == block_.extent.quads - 1 ? north_.stride : 1);
}

}  // namespace selenograph::dem
