#include "engine/indirect/terrain_heights.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <unordered_map>
#include <vector>

#include "dem/base/parallel.h"
#include "dem/base/vector_targets.h"
#include "dem/terrain/surface_place.h"
#include "engine/scene/mesh.h"

namespace selenograph::engine {
namespace {

using dem::BlockId;

using dem::Ticks;

// Latitude and longitude, radians. to_geographic() would compute heights, too.
struct Angles {
  double lat, lon;
};
Angles angles_of(const Vec3& d) {
  return {std::atan2(d.z(), std::sqrt(d.x() * d.x() + d.y() * d.y())), std::atan2(d.y(), d.x())};
}

// Computes the angles of up to kGroup directions, mostly next to each other: the first by arctangents, the others by a
// series from there. The group's fixed size lets the loop vectorise.
constexpr std::size_t kGroup = 16;
void angles_of(std::span<const Vec3> directions, Angles* out) {
  const Vec3& first = directions.front();
  const Angles from = angles_of(first);
  const double fx = first.x(), fy = first.y(), fz = first.z(), fr = std::sqrt(fx * fx + fy * fy);
  double x[kGroup] = {}, y[kGroup] = {}, z[kGroup] = {}, lat[kGroup], lon[kGroup], tangent[kGroup];
  for (std::size_t i = 0; i < directions.size(); ++i) {
    x[i] = directions[i].x();
    y[i] = directions[i].y();
    z[i] = directions[i].z();
  }
  // The series has an error of 1e-16 up to this tangent.
  constexpr double kLargest = 0.03;
  const auto angle = [](double t) {
    const double square = t * t;
    return t - t * square * (1.0 / 3 - square * (1.0 / 5 - square * (1.0 / 7 - square / 9)));
  };
  SELENOGRAPH_INDEPENDENT_LANES
  for (std::size_t i = 0; i < kGroup; ++i) {
    const double r = std::sqrt(x[i] * x[i] + y[i] * y[i]);
    const double around = fx * x[i] + fy * y[i], up = fr * r + fz * z[i];
    const double t = (fx * y[i] - fy * x[i]) / around, u = (fr * z[i] - fz * r) / up;
    const double across = t < 0 ? -t : t, along = u < 0 ? -u : u, larger = across > along ? across : along;
    lon[i] = from.lon + angle(t);
    lat[i] = from.lat + angle(u);
    tangent[i] = (around > 0) & (up > 0) ? larger : 1;
  }
  for (std::size_t i = 0; i < directions.size(); ++i)
    out[i] = tangent[i] < kLargest ? Angles{lat[i], lon[i]} : angles_of(directions[i]);
}

// Returns a block's height at a position, linear in the triangle of its quad.
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

// Returns the coarsest level whose posts on a meridian are at most that far apart.
int level_of(double spacing_m) {
  const double level = std::log2(dem::post_spacing_m(0) / spacing_m);
  return std::clamp(static_cast<int>(std::ceil(level - 1e-6)), 0, dem::kMaxLevel);
}

// Blocks of one level at given directions, loaded once each.
class BlocksAtDirections {
 public:
  BlocksAtDirections(const dem::Terrain& terrain, int level, std::span<const Vec3> directions, const StopToken& stop)
      : ticks_(directions.size()), slots_(directions.size()) {
    std::vector<BlockId> ids(directions.size());
    in_parallel_pieces(ids.size(), 4096, [&](std::size_t first, std::size_t past_last) {
      stop.check();
      for (std::size_t group = first; group < past_last; group += kGroup) {
        const std::size_t end = std::min(group + kGroup, past_last);
        Angles angles[kGroup];
        angles_of(directions.subspan(group, end - group), angles);
        for (std::size_t i = group; i < end; ++i) {
          const auto& [lat, lon] = angles[i - group];
          ticks_[i] = dem::ticks_of(lat / kRadiansPerDegree, lon / kRadiansPerDegree);
          ids[i] = dem::block_at(level, ticks_[i].whole_lat, ticks_[i].whole_lon);
        }
      }
    });
    // Neighbouring directions mostly share a block.
    std::unordered_map<BlockId, std::uint32_t, dem::BlockIdHash> slot_of_id;
    std::unordered_map<BlockId, std::uint32_t, dem::BlockIdHash> slot_of_ancestor;
    std::vector<BlockId> ids_to_load;
    for (std::size_t i = 0; i < ids.size(); ++i) {
      if (i > 0 && ids[i] == ids[i - 1]) {
        slots_[i] = slots_[i - 1];
        continue;
      }
      const auto [entry, is_new] = slot_of_id.try_emplace(ids[i], 0);
      if (is_new) {
        BlockId id = ids[i];
        if (!terrain.has_data(id)) {
          entry->second = kNone;
        } else {
          if (const int finest = terrain.posts_level(id); finest < id.level)
            id = dem::ancestor_of(id, std::max(finest, 0));
          const auto [slot, first] = slot_of_ancestor.try_emplace(id, static_cast<std::uint32_t>(ids_to_load.size()));
          if (first) ids_to_load.push_back(id);
          entry->second = slot->second;
        }
      }
      slots_[i] = entry->second;
    }
    blocks_ = load_blocks(terrain, ids_to_load, nullptr, stop);
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
    const BlocksAtDirections blocks(terrain, level_of(spacing_m), directions, stop);
    in_parallel_pieces(heights.size(), 4096, [&](std::size_t first, std::size_t past_last) {
      for (std::size_t i = first; i < past_last; ++i) heights[i] = blocks.height(i);
    });
  };
}

}  // namespace selenograph::engine
