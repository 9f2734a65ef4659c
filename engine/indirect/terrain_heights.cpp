#include "engine/indirect/terrain_heights.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <unordered_map>
#include <vector>

#include "dem/support/parallel.h"
#include "dem/terrain/surface_place.h"
#include "engine/scene/mesh.h"

namespace selenograph::engine {
namespace {

using dem::BlockId;

using dem::Ticks;

// Of a unit direction: to_geographic(), which finds heights, too, would double the time of a relief.
Ticks ticks_at(const Vec3& direction) {
  const double lat =
                   std::atan2(direction.z(), std::sqrt(direction.x() * direction.x() + direction.y() * direction.y())),
               lon = std::atan2(direction.y(), direction.x());
  return dem::ticks_of(lat / kRadiansPerDegree, lon / kRadiansPerDegree);
}

float height_at(const dem::Block& block, const Ticks& at) {
  const dem::BlockExtent& e = block.extent;
  const auto fraction = [&](double ticks, std::int32_t first, std::int32_t step) {
    return std::clamp((ticks - first) / step, 0.0, static_cast<double>(e.quads));
  };
  const double y = fraction(at.lat, e.lat0, e.lat_step), x = fraction(at.lon, e.lon0, e.lon_step);
  const int r = std::min(static_cast<int>(y), e.quads - 1), c = std::min(static_cast<int>(x), e.quads - 1);
  const auto a = static_cast<float>(x - c), b = static_cast<float>(y - r);
  const auto post = [&](int row, int column) { return block.vertices[block.index(row, column)].height_m; };
  const float south_east = post(r, c + 1), north_west = post(r + 1, c);
  if (a + b <= 1) {
    const float corner = post(r, c);
    return corner + a * (south_east - corner) + b * (north_west - corner);
  }
  const float corner = post(r + 1, c + 1);
  return corner + (1 - a) * (north_west - corner) + (1 - b) * (south_east - corner);
}

// The level with posts as close as that, on a meridian.
int level_of(double spacing_m) {
  const double level = std::log2(dem::post_spacing_m(0) / spacing_m);
  return std::clamp(static_cast<int>(std::ceil(level - 1e-6)), 0, dem::kMaxLevel);
}

class BlocksAround {
 public:
  BlocksAround(const dem::Terrain& terrain, int level, std::span<const Vec3> directions, const StopToken& stop)
      : ticks_(directions.size()), slots_(directions.size()) {
    std::vector<BlockId> ids(directions.size());
    in_parallel_pieces(ids.size(), 4096, [&](std::size_t first, std::size_t past_last) {
      stop.check();
      for (std::size_t i = first; i < past_last; ++i) {
        ticks_[i] = ticks_at(directions[i]);
        ids[i] =
            dem::block_at(level, static_cast<std::int32_t>(ticks_[i].lat), static_cast<std::int32_t>(ticks_[i].lon));
      }
    });
    // Neighbours are mostly in one block.
    std::unordered_map<BlockId, std::uint32_t, dem::BlockIdHash> found;
    std::unordered_map<BlockId, std::uint32_t, dem::BlockIdHash> loaded;
    std::vector<BlockId> wanted;
    for (std::size_t i = 0; i < ids.size(); ++i) {
      if (i > 0 && ids[i] == ids[i - 1]) {
        slots_[i] = slots_[i - 1];
        continue;
      }
      const auto [known, is_new] = found.try_emplace(ids[i], 0);
      if (is_new) {
        BlockId id = ids[i];
        if (!terrain.has_data(id)) {
          known->second = kNone;
        } else {
          if (const int finest = terrain.posts_level(id); finest < id.level)
            id = dem::ancestor_of(id, std::max(finest, 0));
          const auto [slot, first] = loaded.try_emplace(id, static_cast<std::uint32_t>(wanted.size()));
          if (first) wanted.push_back(id);
          known->second = slot->second;
        }
      }
      slots_[i] = known->second;
    }
    blocks_ = load_blocks(terrain, wanted, nullptr, stop);
  }

  float height(std::size_t i) const {
    const auto& block = slots_[i] == kNone ? nullptr : blocks_[slots_[i]];
    return block ? height_at(*block, ticks_[i]) : std::numeric_limits<float>::quiet_NaN();
  }

 private:
  static constexpr std::uint32_t kNone = 0xffffffff;
  std::vector<Ticks> ticks_;
  std::vector<std::uint32_t> slots_;
  std::vector<std::shared_ptr<const dem::Block>> blocks_;
};

}  // namespace

ReliefHeights heights_of(const dem::Terrain& terrain, const StopToken& stop) {
  return [&terrain, &stop](double spacing_m, std::span<const Vec3> directions, std::span<float> heights) {
    const BlocksAround blocks(terrain, level_of(spacing_m), directions, stop);
    in_parallel_pieces(heights.size(), 4096, [&](std::size_t first, std::size_t past_last) {
      for (std::size_t i = first; i < past_last; ++i) heights[i] = blocks.height(i);
    });
  };
}

}  // namespace selenograph::engine
