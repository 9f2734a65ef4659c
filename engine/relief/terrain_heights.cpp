#include "engine/relief/terrain_heights.h"

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

// Latitude and longitude, radians.
struct Angles {
  double lat, lon;
};
// Returns the angles of a direction. to_geographic() would compute a height, too.
Angles angles_of(const Vec3& d) {
  return {std::atan2(d.z(), std::sqrt(d.x() * d.x() + d.y() * d.y())), std::atan2(d.y(), d.x())};
}

// Number of directions whose angles are computed together. Being fixed, it lets the loop vectorise.
constexpr std::size_t kGroup = 16;
// Sets the angles of up to kGroup directions, mostly next to each other. The first one's are computed by arctangents;
// the others' are the first one's plus arctangents of the small differences, by a series.
void angles_of(std::span<const Vec3> directions, Angles* out) {
  const Vec3& first = directions.front();
  const Angles first_angles = angles_of(first);
  // fr: distance of the first direction from the polar axis.
  const double fx = first.x(), fy = first.y(), fz = first.z(), fr = std::sqrt(fx * fx + fy * fy);
  double x[kGroup] = {}, y[kGroup] = {}, z[kGroup] = {}, lat[kGroup], lon[kGroup], larger_tangent[kGroup];
  for (std::size_t i = 0; i < directions.size(); ++i) {
    x[i] = directions[i].x();
    y[i] = directions[i].y();
    z[i] = directions[i].z();
  }
  // The series of the arctangent has an error of 1e-16 up to this tangent.
  constexpr double kMaxTangent = 0.03;
  const auto arctangent = [](double t) {
    const double square = t * t;
    return t - t * square * (1.0 / 3 - square * (1.0 / 5 - square * (1.0 / 7 - square / 9)));
  };
  SELENOGRAPH_INDEPENDENT_LANES
  for (std::size_t i = 0; i < kGroup; ++i) {
    const double r = std::sqrt(x[i] * x[i] + y[i] * y[i]);
    // Tangents are sines over cosines: cross and dot products of (x, y) for the longitude, of (r, z) for the latitude.
    const double lon_dot = fx * x[i] + fy * y[i], lat_dot = fr * r + fz * z[i];
    const double lon_tangent = (fx * y[i] - fy * x[i]) / lon_dot, lat_tangent = (fr * z[i] - fz * r) / lat_dot;
    const double lon_size = lon_tangent < 0 ? -lon_tangent : lon_tangent,
                 lat_size = lat_tangent < 0 ? -lat_tangent : lat_tangent;
    lon[i] = first_angles.lon + arctangent(lon_tangent);
    lat[i] = first_angles.lat + arctangent(lat_tangent);
    // A direction more than 90 degrees away gets 1, beyond the series.
    larger_tangent[i] = (lon_dot > 0) & (lat_dot > 0) ? (lon_size > lat_size ? lon_size : lat_size) : 1;
  }
  for (std::size_t i = 0; i < directions.size(); ++i)
    out[i] = larger_tangent[i] < kMaxTangent ? Angles{lat[i], lon[i]} : angles_of(directions[i]);
}

// Returns a block's height in metres at a position, linear in the triangle of its quad. Quads are cut from the
// south-eastern to the north-western corner.
float height_at(const dem::Block& block, const Ticks& position) {
  const dem::BlockExtent& e = block.extent;
  const auto quads_from = [&](double ticks, dem::Tick first, dem::Tick step) {
    return std::clamp((ticks - first) / step, 0.0, static_cast<double>(e.quads));
  };
  const double y = quads_from(position.lat, e.lat0, e.lat_step), x = quads_from(position.lon, e.lon0, e.lon_step);
  const int row = std::min(static_cast<int>(y), e.quads - 1), column = std::min(static_cast<int>(x), e.quads - 1);
  const auto east = static_cast<float>(x - column), north = static_cast<float>(y - row);  // shares of the quad
  const auto height_m = [&](int r, int c) { return block.vertices[block.index(r, c)].height_m; };
  const float south_east = height_m(row, column + 1), north_west = height_m(row + 1, column);
  if (east + north <= 1) {
    const float south_west = height_m(row, column);
    return south_west + east * (south_east - south_west) + north * (north_west - south_west);
  }
  const float north_east = height_m(row + 1, column + 1);
  return north_east + (1 - east) * (north_west - north_east) + (1 - north) * (south_east - north_east);
}

// Returns the coarsest level whose posts on a meridian are at most that far apart, but for rounding.
int level_of(double spacing_m) {
  const double level = std::log2(dem::post_spacing_m(0) / spacing_m);
  return std::clamp(static_cast<int>(std::ceil(level - 1e-6)), 0, dem::kMaxLevel);
}

bool lies_in(const dem::BlockExtent& e, const Ticks& t) {
  return t.whole_lat >= e.lat0 && t.whole_lat < e.lat1() && t.whole_lon >= e.lon0 && t.whole_lon < e.lon1();
}

// Blocks of one level at given directions, loaded once each.
class BlocksAtDirections {
 public:
  BlocksAtDirections(const dem::Terrain& terrain, int level, std::span<const Vec3> directions, const StopToken& stop)
      : ticks_(directions.size()), slots_(directions.size()) {
    std::vector<BlockId> ids(directions.size());
    in_parallel_pieces(ids.size(), 4096, [&](std::size_t first, std::size_t past_last) {
      stop.check();
      BlockId id;
      dem::BlockExtent extent{};  // of the last direction's block
      for (std::size_t group = first; group < past_last; group += kGroup) {
        const std::size_t end = std::min(group + kGroup, past_last);
        Angles angles[kGroup];
        angles_of(directions.subspan(group, end - group), angles);
        for (std::size_t i = group; i < end; ++i) {
          const auto& [lat, lon] = angles[i - group];
          const Ticks& ticks = ticks_[i] = dem::ticks_of(lat / kRadiansPerDegree, lon / kRadiansPerDegree);
          if (!lies_in(extent, ticks)) {  // spares a lookup: neighbouring directions mostly share a block
            id = dem::block_at(level, ticks.whole_lat, ticks.whole_lon);
            extent = dem::extent_of(id);
          }
          ids[i] = id;
        }
      }
    });
    // Number the blocks to load. Where posts end at a coarser level, several blocks share one ancestor.
    std::unordered_map<BlockId, std::uint32_t, dem::BlockIdHash> slot_of_id;
    std::unordered_map<BlockId, std::uint32_t, dem::BlockIdHash> slot_of_ancestor;
    std::vector<BlockId> ids_to_load;
    for (std::size_t i = 0; i < ids.size(); ++i) {
      if (i > 0 && ids[i] == ids[i - 1]) {  // spares a lookup
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

  // Returns the height in metres in the direction with this index; NaN without data.
  float height_m(std::size_t i) const {
    const auto& block = slots_[i] == kNone ? nullptr : blocks_[slots_[i]];
    return block ? height_at(*block, ticks_[i]) : std::numeric_limits<float>::quiet_NaN();
  }

 private:
  static constexpr std::uint32_t kNone = 0xffffffff;
  std::vector<Ticks> ticks_;          // position per direction
  std::vector<std::uint32_t> slots_;  // index in blocks_ per direction; kNone: no data
  std::vector<std::shared_ptr<const dem::Block>> blocks_;
};

}  // namespace

ReliefHeights heights_of(const dem::Terrain& terrain, const StopToken& stop) {
  return [&terrain, &stop](double spacing_m, std::span<const Vec3> directions, std::span<float> heights) {
    const BlocksAtDirections blocks(terrain, level_of(spacing_m), directions, stop);
    in_parallel_pieces(heights.size(), 4096, [&](std::size_t first, std::size_t past_last) {
      for (std::size_t i = first; i < past_last; ++i) heights[i] = blocks.height_m(i);
    });
  };
}

}  // namespace selenograph::engine
