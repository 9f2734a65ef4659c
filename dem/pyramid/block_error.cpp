#include "dem/pyramid/block_error.h"

#include <cmath>
#include <utility>

#include "dem/base/parallel.h"
#include "dem/posts/post_kernels.h"
#include "dem/pyramid/block_posts.h"

namespace selenograph::dem {

namespace {

// Measures a block quad by quad: the largest distance of the base's posts from the block's triangles, and the range of
// both surfaces' heights. Works for any ratio of longitude steps. Heights are linear in latitude and longitude within a
// triangle: the chord's sag over the sphere is accounted for separately (lattice.h, chord_sag_m). The diagonal runs
// from the south-east to the north-west corner, as in the rendered mesh.
Extremes measure_by_quads(const OctaveGrid& grid, const BlockCut& cut, const OctaveGrid& base) {
  const BlockExtent e = extent_of(cut.id);
  // Base posts per quad, and the base post at the block's south-west corner.
  const int step_r = steps_in(e.lat_step, base.window.lat_step), step_c = steps_in(e.lon_step, base.window.lon_step);
  const int base_r0 = steps_in(e.lat0 - base.window.lat0, base.window.lat_step);
  const int base_c0 = steps_in(e.lon0 - base.window.lon0, base.window.lon_step);
  float largest_m = 0, low = std::numeric_limits<float>::max(), high = std::numeric_limits<float>::lowest();
  const float inv_r = 1.F / static_cast<float>(step_r), inv_c = 1.F / static_cast<float>(step_c);
  for (int r = 0; r < e.quads; ++r)
    for (int c = 0; c < e.quads; ++c) {
      // Corners: h00 south-west, h10 south-east, h01 north-west, h11 north-east.
      const float h00 = grid.at(cut.r0 + r, cut.c0 + c * cut.stride_c),
                  h10 = grid.at(cut.r0 + r, cut.c0 + (c + 1) * cut.stride_c);
      const float h01 = grid.at(cut.r0 + r + 1, cut.c0 + c * cut.stride_c),
                  h11 = grid.at(cut.r0 + r + 1, cut.c0 + (c + 1) * cut.stride_c);
      for (const float h : {h00, h10, h01, h11})
        if (!std::isnan(h)) {
          low = std::min(low, h);
          high = std::max(high, h);
        }
      for (int y = 0; y <= step_r; ++y) {
        const float fy = static_cast<float>(y) * inv_r;
        const float* row = &base.posts.heights[base.index(base_r0 + r * step_r + y, base_c0 + c * step_c)];
        for (int x = 0; x <= step_c; ++x) {
          const float fx = static_cast<float>(x) * inv_c, h = row[x];
          const float lower = h00 + fx * (h10 - h00) + fy * (h01 - h00),
                      upper = h11 + (1 - fx) * (h01 - h11) + (1 - fy) * (h10 - h11);
          const float distance = std::abs(h - (fx + fy <= 1 ? lower : upper));
          // Comparisons with NaN are false: voids do not count.
          if (distance > largest_m) largest_m = distance;
          if (h < low) low = h;
          if (h > high) high = h;
        }
      }
    }
  return {largest_m, low, high};
}

// Returns the height range of a square of posts, with an error of 0.
Extremes range_of(const OctaveGrid& grid, int r0, int c0, int quads) {
  const Extremes none;
  HeightRange range{none.low, none.high};
  for (int r = 0; r <= quads; ++r) extend_range(grid.row(r0 + r) + c0, quads + 1, range);
  return {0, range.low, range.high};
}

// Writes the heights of a surface of quads x quads quads at the posts of the next finer level: at vertices, and in the
// middles of edges and diagonals. `stride`: floats from one row of `in` to the next; `out` has no gaps.
void refine_surface(const float* in, int stride, int quads, float* out) {
  const int out_side = 2 * quads + 1;
  for (int r = 0; r <= quads; ++r, in += stride, out += 2 * static_cast<std::ptrdiff_t>(out_side)) {
    refine_row(in, quads, out);
    if (r < quads) refine_between_rows(in, in + stride, quads, out + out_side);
  }
}

// Returns the largest distance between a square of base posts and a surface sampled at these posts.
float largest_distance_in(const OctaveGrid& base, int r0, int c0, int quads, const float* surface) {
  float largest_m = 0;
  for (int r = 0; r <= quads; ++r)
    largest_m = largest_distance(base.row(r0 + r) + c0, surface + static_cast<std::ptrdiff_t>(r) * (quads + 1),
                                 quads + 1, largest_m);
  return largest_m;
}

// Measures all blocks of a chunk whose grids and blocks halve from level to level: all but those where the longitude
// step changes. Works tile by tile of the base, small enough for a core's nearest cache. Each level's surface is
// refined octave by octave to the base's posts: the largest distance always occurs at one of these.
class TileMeasurement {
 public:
  TileMeasurement(const ChunkPlan& plan, const OctaveGrid& base, const std::vector<OctaveGrid>& levels)
      : node_(plan.node),
        base_(base),
        levels_(levels),
        tile_(std::min(kTile, quads_per_side(plan.node.level) << (base.level - plan.node.level))) {
    for (const OctaveGrid& grid : levels) starts_.push_back(start_of(grid));
  }

  // Returns whether all grids and all blocks of the chunk halve from level to level.
  static bool is_possible(const ChunkPlan& plan, const OctaveGrid& base, const std::vector<OctaveGrid>& levels) {
    const OctaveGrid* fine = &base;
    for (const OctaveGrid& grid : levels) {
      if (grid.window.lon_step != 2 * fine->window.lon_step) return false;
      fine = &grid;
    }
    // The longitude step of blocks is largest at the northern or southern end.
    for (int level = plan.coarsest_level(); level <= base.level; ++level)
      for (const Tick lat : {extent_of(plan.node).lat0, extent_of(plan.node).lat1() - 1})
        if (extent_of(block_at(level, lat, extent_of(plan.node).lon0)).lon_step != grid_lon_step(plan.node, level))
          return false;
    return true;
  }

  // Measures all tiles in parallel, then merges the tiles of each block.
  BlockExtremes measure(const StopToken& stop) const {
    const int side = steps_in(extent_of(node_).lat1() - extent_of(node_).lat0, base_.window.lat_step) / tile_;
    std::vector<TileExtremes> tiles(static_cast<std::size_t>(side) * static_cast<std::size_t>(side));
    in_parallel(tiles.size(), [&](std::size_t i) {
      stop.check();
      tiles[i] = measure_tile(static_cast<int>(i) / side * tile_, static_cast<int>(i) % side * tile_);
    });
    BlockExtremes found;
    for (const TileExtremes& tile : tiles) {
      for (const auto& [id, extremes] : tile.base) found[id].add(extremes);
      Extremes tile_range;
      for (const auto& [id, extremes] : tile.base) tile_range.add(extremes);
      for (std::size_t i = 0; i < levels_.size(); ++i) {
        Extremes& level = found[block_at(levels_[i].level, tile.lat, tile.lon)];
        level.add(tile_range);
        level.add({tile.error_m[i], level.low, level.high});
      }
    }
    // Add the range of the filtered heights. They may leave the range of their base next to a void that was left out,
    // or at a pole, whose height is not filtered.
    for (auto& [id, extremes] : found)
      if (id.level < base_.level) {
        const OctaveGrid& grid = levels_[static_cast<std::size_t>(base_.level - 1 - id.level)];
        const BlockCut cut = cut_of(grid, id);
        extremes.add(range_of(grid, cut.r0, cut.c0, quads_per_side(id.level)));
      }
    return found;
  }

 private:
  static constexpr int kTile = 128;  // base posts along a side: 64 KB of floats
  static constexpr int kOctaves =
      6;  // most octaves by which a tile's surface is refined; a tile has two quads of the coarsest of these levels

  struct TileExtremes {
    Tick lat = 0, lon = 0;                           // ticks of the tile's south-west corner
    std::vector<std::pair<BlockId, Extremes>> base;  // extremes of the blocks of base posts
    std::vector<float> error_m;                      // largest distance, per level of `levels_`
  };

  // Posts from which a tile's surface is refined: the level's own posts over the node. If a tile is narrower than two
  // of their quads, these posts are refined first.
  struct Start {
    int octaves = 0;  // octaves from these posts to the base
    int stride = 0;
    const float* posts = nullptr;  // post at the node's south-west corner
    std::vector<float> refined;
  };

  // Finds a level's start; refines the level's posts over the whole node where tiles are too small to begin with them.
  Start start_of(const OctaveGrid& grid) const {
    Start start;
    start.octaves = base_.level - grid.level;
    start.stride = grid.window.cols;
    start.posts = grid.posts.heights.data() + grid.index(grid.halo, grid.halo);
    int quads = grid.window.rows - 1 - 2 * grid.halo;
    std::vector<float> finer;
    for (; start.octaves > kOctaves || (tile_ >> start.octaves) < 1; --start.octaves) {
      finer.resize(static_cast<std::size_t>(2 * quads + 1) * static_cast<std::size_t>(2 * quads + 1));
      refine_surface(start.posts, start.stride, quads, finer.data());
      start.refined.swap(finer);
      quads *= 2;
      start.posts = start.refined.data();
      start.stride = quads + 1;
    }
    return start;
  }

  // Measures the tile whose south-west corner is base post (row, col), counted from the node's corner.
  TileExtremes measure_tile(int row, int col) const {
    TileExtremes tile;
    tile.lat = extent_of(node_).lat0 + row * base_.window.lat_step;
    tile.lon = extent_of(node_).lon0 + col * base_.window.lon_step;
    const int quads = quads_per_side(base_.level);
    for (int r = 0; r < tile_; r += quads)
      for (int c = 0; c < tile_; c += quads)
        tile.base.emplace_back(
            block_at(base_.level, tile.lat + r * base_.window.lat_step, tile.lon + c * base_.window.lon_step),
            range_of(base_, base_.halo + row + r, base_.halo + col + c, quads));
    tile.error_m.resize(starts_.size());
    if (std::all_of(tile.base.begin(), tile.base.end(), [](const auto& b) { return b.second.low > b.second.high; }))
      return tile;
    const std::size_t max_posts = static_cast<std::size_t>(tile_ + 1) * static_cast<std::size_t>(tile_ + 1);
    std::vector<float> refined(max_posts), spare(max_posts);
    for (std::size_t i = 0; i < starts_.size(); ++i) {
      const Start& start = starts_[i];
      const float* surface =
          start.posts + static_cast<std::ptrdiff_t>(row >> start.octaves) * start.stride + (col >> start.octaves);
      int stride = start.stride, n = tile_ >> start.octaves;
      for (int k = 0; k < start.octaves; ++k) {
        refine_surface(surface, stride, n, refined.data());
        n *= 2;
        stride = n + 1;
        surface = refined.data();
        refined.swap(spare);  // the surface stays where it is; the next octave is written to the other array
      }
      tile.error_m[i] = largest_distance_in(base_, base_.halo + row, base_.halo + col, tile_, surface);
    }
    return tile;
  }

  BlockId node_;
  const OctaveGrid& base_;
  const std::vector<OctaveGrid>& levels_;
  int tile_;
  std::vector<Start> starts_;
};

// Measures all blocks of a chunk at the base's posts: tile by tile where possible, which is faster, else quad by quad.
BlockExtremes measure_at_posts(const ChunkPlan& plan, const OctaveGrid& base, const std::vector<OctaveGrid>& levels,
                               const StopToken& stop) {
  if (TileMeasurement::is_possible(plan, base, levels)) return TileMeasurement(plan, base, levels).measure(stop);
  BlockExtremes found;
  const auto add_level = [&](const OctaveGrid& grid) {
    const std::vector<BlockId> ids = blocks_of(plan.node, grid.level);
    std::vector<Extremes> extremes(ids.size());
    in_parallel(ids.size(), [&](std::size_t i) {
      stop.check();
      extremes[i] = measure_by_quads(grid, cut_of(grid, ids[i]), base);
    });
    for (std::size_t i = 0; i < ids.size(); ++i) found.emplace(ids[i], extremes[i]);
  };
  add_level(base);
  for (const OctaveGrid& grid : levels) add_level(grid);
  return found;
}

// Returns the error of a block of posts coarser than kSmoothLevel against its own subdivision to that level, m. Where
// finer levels divide quads in both directions, the triangles stay as they are: no error. If finer levels divide quads
// from south to north only, they converge to a ruled surface. In the middle of a quad's diagonal it is a quarter of the
// quad's twist (sum of two opposite corners minus the sum of the others) off the triangles.
float twist_of(const OctaveGrid& base, const BlockCut& cut) {
  const BlockExtent e = extent_of(cut.id);
  const auto lon_step_at = [&](Tick lat) { return extent_of(block_at(kSmoothLevel, lat, e.lon0)).lon_step; };
  const Tick lon_step_if_halved = e.lon_step >> (kSmoothLevel - cut.id.level);
  if (std::max(lon_step_at(e.lat0), lon_step_at(e.lat1() - 1)) == lon_step_if_halved) return 0;
  float largest_twist = 0;
  for (int r = cut.r0; r < cut.r0 + e.quads; ++r)
    for (int c = cut.c0; c < cut.c0 + e.quads * cut.stride_c; c += cut.stride_c) {
      const float twist =
          base.at(r, c) + base.at(r + 1, c + cut.stride_c) - base.at(r, c + cut.stride_c) - base.at(r + 1, c);
      if (std::abs(twist) > largest_twist) largest_twist = std::abs(twist);
    }
  return largest_twist / 4;
}

}  // namespace

// Measures at the posts; for a base coarser than kSmoothLevel, adds the error of the base itself.
BlockExtremes measure_blocks(const ChunkPlan& plan, const OctaveGrid& base, const std::vector<OctaveGrid>& levels,
                             const StopToken& stop) {
  BlockExtremes found = measure_at_posts(plan, base, levels, stop);
  if (!plan.direct || base.level >= kSmoothLevel) return found;
  // Add the base's own error to the errors of all coarser blocks above it.
  std::unordered_map<BlockId, float, BlockIdHash> added_m;
  for (const BlockId& id : blocks_of(plan.node, base.level)) {
    float& own_error_m = found.at(id).error_m;
    const float twist_m = twist_of(base, cut_of(base, id)), total_m = own_error_m + twist_m;
    own_error_m = twist_m;
    for (const OctaveGrid& grid : levels) {
      float& largest = added_m[ancestor_of(id, grid.level)];
      largest = std::max(largest, total_m);
    }
  }
  for (const auto& [id, error_m] : added_m) found.at(id).error_m += error_m;
  return found;
}

}  // namespace selenograph::dem
