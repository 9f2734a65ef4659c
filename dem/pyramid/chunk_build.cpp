// Builds a chunk: composes posts, filters octave by octave, measures each block's error.
#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>
#include <utility>

#include "dem/grid/shading_normals.h"
#include "dem/posts/post_kernels.h"
#include "dem/pyramid/block_posts.h"
#include "dem/pyramid/chunk.h"
#include "dem/pyramid/chunk_format.h"
#include "dem/support/parallel.h"

namespace selenograph::dem {
namespace {

// Posts of one level over the chunk and a halo around it.
struct Grid {
  int level = 0;
  int halo = 0;  // posts beyond the chunk on each side
  PostWindow window;
  PostGridRows posts;
  float at(int r, int c) const {
    r = std::clamp(r, 0, window.rows - 1), c = std::clamp(c, 0, window.cols - 1);
    return posts.heights[index(r, c)];
  }
  std::size_t index(int r, int c) const {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(window.cols) + static_cast<std::size_t>(c);
  }
  const float* row(int r) const { return posts.heights.data() + index(std::clamp(r, 0, window.rows - 1), 0); }
};

PostWindow window_of(const BlockId& node, int level, int halo) {
  const BlockExtent e = extent_of(node);
  PostWindow w;
  w.lat_step = 1 << (kTickLevel - level);
  w.lon_step = grid_lon_step(node, level);
  w.lat0 = e.lat0 - static_cast<std::int64_t>(halo) * w.lat_step;
  w.lon0 = e.lon0 - static_cast<std::int64_t>(halo) * w.lon_step;
  w.rows = (e.lat1() - e.lat0) / w.lat_step + 1 + 2 * halo;
  w.cols = (e.lon1() - e.lon0) / w.lon_step + 1 + 2 * halo;
  return w;
}

// Each octave takes one post of halo from the finer level, and kHalo posts must be left at the coarsest.
int base_halo(const ChunkPlan& plan) { return (kHalo + 1) << (plan.base_level - plan.node.level); }

Grid direct_base(const ChunkPlan& plan, const PostSource& source, Chunk::Scratch& scratch, const StopToken& stop) {
  Grid grid{plan.base_level, base_halo(plan) + kFillReach, {}, scratch.take()};
  grid.window = window_of(plan.node, grid.level, grid.halo);
  source.compose_filled(grid.window, grid.posts, stop);
  return grid;
}

// Copies a finer chunk's top block into the grid. Near a pole its columns can be wider apart than the grid's: posts
// between are interpolated along the row.
void paste(const Block& block, Grid& grid, std::vector<SourceMark>& marks) {
  const BlockExtent& e = block.extent;
  const int stride = std::max(e.lon_step / grid.window.lon_step, 1);  // never less
  const std::int64_t turn = std::llround(static_cast<double>(grid.window.lon0 - e.lon0) / kLonTicks);
  for (const std::int64_t shift : {turn - 1, turn, turn + 1})
    for (int r = 0; r <= e.quads; ++r) {
      const std::int64_t row =
          (e.lat0 + static_cast<std::int64_t>(r) * e.lat_step - grid.window.lat0) / grid.window.lat_step;
      if (row < 0 || row >= grid.window.rows) continue;
      const std::int64_t col0 = (e.lon0 + shift * kLonTicks - grid.window.lon0) / grid.window.lon_step;
      for (int c = 0; c <= e.quads * stride; ++c) {
        const std::int64_t col = col0 + c;
        if (col < 0 || col >= grid.window.cols) continue;
        const int a = c / stride, b = std::min(a + 1, e.quads);
        const float t = static_cast<float>(c % stride) / static_cast<float>(stride);
        const float ha = block.vertices[block.index(r, a)].height_m, hb = block.vertices[block.index(r, b)].height_m;
        const std::size_t at = grid.index(static_cast<int>(row), static_cast<int>(col));
        grid.posts.heights[at] = t == 0 ? ha : ha + t * (hb - ha);
        marks[at] = block.source(r, a);
      }
    }
}

// What the finer chunks' top blocks leave out of the finest surface: largest distance, and how far it goes below and
// above them.
struct LeftOut {
  double error_m = 0;
  float below_m = 0, above_m = 0;
  void add(const Block& block) {
    error_m = std::max(error_m, block.error_m);
    float low = std::numeric_limits<float>::max(), high = std::numeric_limits<float>::lowest();
    for (const Vertex& v : block.vertices)
      if (!std::isnan(v.height_m)) low = std::min(low, v.height_m), high = std::max(high, v.height_m);
    below_m = std::max(below_m, low - block.min_m), above_m = std::max(above_m, block.max_m - high);
  }
};

Grid base_from_finer(const ChunkPlan& plan, const Chunk::Finer& finer, LeftOut& left_out, Chunk::Scratch& scratch,
                     const StopToken& stop) {
  Grid grid{plan.base_level, base_halo(plan), {}, scratch.take()};
  grid.window = window_of(plan.node, grid.level, grid.halo);
  grid.posts.heights.assign(grid.window.size(), kNoHeight_m);
  std::vector<SourceMark> marks(grid.window.size(), kNoSource);
  grid.posts.replaced = finer.replaced;
  for (const BlockId& id : Chunk::finer_blocks(plan)) {
    stop.check();
    if (const auto& block = finer.blocks.at(id)) {
      paste(*block, grid, marks);
      left_out.add(*block);
    }
  }
  grid.posts.sources.reset(grid.window.rows, grid.window.cols);
  for (int r = 0; r < grid.window.rows; ++r) grid.posts.sources.set(r, marks.data() + grid.index(r, 0));
  return grid;
}

// Weighted mean of the valid posts under the 3 x 3 binomial; a position that is void stays void.
float filtered_beside_voids(const Grid& fine, int r, int c, bool along_row) {
  if (std::isnan(fine.at(r, c))) return kNoHeight_m;
  float sum = 0, weight = 0;
  for (int y = -1; y <= 1; ++y)
    for (int x = along_row ? -1 : 0; x <= (along_row ? 1 : 0); ++x) {
      const float h = fine.at(r + y, c + x), w = (y ? 1.F : 2.F) * (x ? 1.F : 2.F);
      if (!std::isnan(h)) sum += w * h, weight += w;
    }
  return sum / weight;
}

// One row of the next coarser level. `buffer` is kept from row to row.
void filter_row(const Grid& fine, int fr, int step_c, bool pole, const Grid& grid, std::vector<float>& buffer,
                float* out) {
  constexpr int kPad = 4;  // what the kernel reaches beyond the finer grid, whose border is repeated
  const int cols = fine.window.cols, n = grid.window.cols;
  buffer.resize(static_cast<std::size_t>(cols) + 2 * kPad);
  float* column = buffer.data() + kPad;
  if (pole)
    std::copy_n(fine.row(fr), cols, column);
  else
    add_three_rows(fine.row(fr - 1), fine.row(fr), fine.row(fr + 1), cols, column);
  std::fill_n(buffer.data(), kPad, column[0]);
  std::fill_n(column + cols, kPad, column[cols - 1]);
  const float* at = column + fine.halo - step_c * grid.halo;
  const auto step = static_cast<float>(format::height_step_m(grid.level));
  if (pole) {  // one point: kept, so that every block around it agrees
    for (int c = 0; c < n; ++c) out[c] = at[static_cast<std::ptrdiff_t>(step_c) * c];
    return;
  }
  if (step_c == 1)
    quantise_row(at, n, 0.25F, step, out);
  else
    halve_row(at, n, step, out);
  for (int c = 0; c < n; ++c) {
    if (!std::isnan(out[c])) continue;
    const float h = filtered_beside_voids(fine, fr, fine.halo + step_c * (c - grid.halo), step_c == 2);
    quantise_row(&h, 1, 1, step, out + c);
  }
}

// Of each column the source of the finer level's there; past its border, of the outermost one.
void coarser_sources(const Grid& fine, int fine_row, int step_c, Grid& grid, int row) {
  grid.posts.sources.clear(row);
  for (const SourceRun& run : fine.posts.sources.row(fine_row)) {
    // The first column that looks beyond the run.
    const int beyond = run.past_last - fine.halo,
              column = grid.halo + (beyond >= 0 ? (beyond + step_c - 1) / step_c : -(-beyond / step_c));
    const bool last = run.past_last == fine.window.cols;
    grid.posts.sources.append(row, run.mark, last ? grid.window.cols : std::clamp(column, 0, grid.window.cols));
  }
}

Grid coarser(const BlockId& node, const Grid& fine, Chunk::Scratch& scratch, const StopToken& stop) {
  Grid grid{fine.level - 1, std::max(kHalo, (fine.halo - 1) / 2), {}, scratch.take()};
  grid.window = window_of(node, grid.level, grid.halo);
  const int step_c = grid.window.lon_step / fine.window.lon_step;  // 1 where the longitude step is at its cap
  grid.posts.heights.resize(grid.window.size());
  grid.posts.sources.reset(grid.window.rows, grid.window.cols);
  constexpr std::size_t kRowsAtOnce = 16;
  in_parallel_pieces(
      static_cast<std::size_t>(grid.window.rows), kRowsAtOnce, [&](std::size_t first, std::size_t past_last) {
        std::vector<float> buffer;
        for (std::size_t row = first; row < past_last; ++row) {
          stop.check();
          const int r = static_cast<int>(row), fr = fine.halo + 2 * (r - grid.halo);
          const std::int64_t lat = grid.window.lat0 + static_cast<std::int64_t>(r) * grid.window.lat_step;
          const bool pole = lat == 0 || lat == kLatTicks;
          filter_row(fine, fr, step_c, pole, grid, buffer, grid.posts.heights.data() + grid.index(r, 0));
          coarser_sources(fine, std::clamp(fr, 0, fine.window.rows - 1), step_c, grid, r);
        }
      });
  return grid;
}

// A block's posts cut out of its level's grid.
struct Cut {
  BlockId id;
  int r0, c0, stride_c;  // grid position of the south-west vertex; grid columns per block column
};

Cut cut_of(const Grid& grid, const BlockId& id) {
  const BlockExtent e = extent_of(id);
  return {id, static_cast<int>((e.lat0 - grid.window.lat0) / grid.window.lat_step),
          static_cast<int>((e.lon0 - grid.window.lon0) / grid.window.lon_step), e.lon_step / grid.window.lon_step};
}

// Of a block: largest vertical distance between its triangles and the base posts beneath; lowest and highest height of
// both. None: low > high.
struct Extremes {
  float error_m = 0, low = std::numeric_limits<float>::max(), high = std::numeric_limits<float>::lowest();
  void add(const Extremes& other) {
    error_m = std::max(error_m, other.error_m), low = std::min(low, other.low), high = std::max(high, other.high);
  }
};

// Quad by quad. Linear in latitude and longitude within a triangle (the chord's sag over the sphere is accounted for
// separately: lattice.h, chord_sag_m); the diagonal runs from the south-east to the north-west corner, as in the
// rendered mesh.
Extremes measured_by_quads(const Grid& grid, const Cut& cut, const Grid& base) {
  const BlockExtent e = extent_of(cut.id);
  const int step_r = e.lat_step / base.window.lat_step, step_c = e.lon_step / base.window.lon_step;
  const int base_r0 = static_cast<int>((e.lat0 - base.window.lat0) / base.window.lat_step);
  const int base_c0 = static_cast<int>((e.lon0 - base.window.lon0) / base.window.lon_step);
  float worst = 0, low = std::numeric_limits<float>::max(), high = std::numeric_limits<float>::lowest();
  const float inv_r = 1.F / static_cast<float>(step_r), inv_c = 1.F / static_cast<float>(step_c);
  for (int r = 0; r < e.quads; ++r)
    for (int c = 0; c < e.quads; ++c) {
      const float h00 = grid.at(cut.r0 + r, cut.c0 + c * cut.stride_c),
                  h10 = grid.at(cut.r0 + r, cut.c0 + (c + 1) * cut.stride_c);
      const float h01 = grid.at(cut.r0 + r + 1, cut.c0 + c * cut.stride_c),
                  h11 = grid.at(cut.r0 + r + 1, cut.c0 + (c + 1) * cut.stride_c);
      for (const float h : {h00, h10, h01, h11})
        if (!std::isnan(h)) low = std::min(low, h), high = std::max(high, h);
      for (int y = 0; y <= step_r; ++y) {
        const float fy = static_cast<float>(y) * inv_r;
        const float* row = &base.posts.heights[base.index(base_r0 + r * step_r + y, base_c0 + c * step_c)];
        for (int x = 0; x <= step_c; ++x) {
          const float fx = static_cast<float>(x) * inv_c, h = row[x];
          const float lower = h00 + fx * (h10 - h00) + fy * (h01 - h00),
                      upper = h11 + (1 - fx) * (h01 - h11) + (1 - fy) * (h10 - h11);
          const float distance = std::abs(h - (fx + fy <= 1 ? lower : upper));
          // Comparisons with NaN are false: voids don't count.
          if (distance > worst) worst = distance;
          if (h < low) low = h;
          if (h > high) high = h;
        }
      }
    }
  return {worst, low, high};
}

Extremes range_of(const Grid& grid, int r0, int c0, int quads) {
  const Extremes none;
  HeightRange range{none.low, none.high};
  for (int r = 0; r <= quads; ++r) extend_range(grid.row(r0 + r) + c0, quads + 1, range);
  return {0, range.low, range.high};
}

// A level's surface at the posts of the next finer one: vertices, and the middles of edges. Of quads x quads quads.
void refine_surface(const float* in, int stride, int quads, float* out) {
  const int wide = 2 * quads + 1;
  for (int r = 0; r <= quads; ++r, in += stride, out += 2 * static_cast<std::ptrdiff_t>(wide)) {
    refine_row(in, quads, out);
    if (r < quads) refine_between_rows(in, in + stride, quads, out + wide);
  }
}

float largest_distance_in(const Grid& base, int r0, int c0, int quads, const float* surface) {
  float worst = 0;
  for (int r = 0; r <= quads; ++r)
    worst = largest_distance(base.row(r0 + r) + c0, surface + static_cast<std::ptrdiff_t>(r) * (quads + 1), quads + 1,
                             worst);
  return worst;
}

using Measured = std::unordered_map<BlockId, Extremes, BlockIdHash>;

// All blocks of a chunk whose grids and blocks halve from level to level: all but those where the longitude step
// changes. Tile by tile of the base, small enough for the nearest cache: each level's surface is refined octave by
// octave to the base's posts, which are exactly where it is farthest from them.
class TileMeasurement {
 public:
  TileMeasurement(const ChunkPlan& plan, const Grid& base, const std::vector<Grid>& levels)
      : node_(plan.node),
        base_(base),
        levels_(levels),
        tile_(std::min(kTile, quads_per_side(plan.node.level) << (base.level - plan.node.level))) {
    for (const Grid& grid : levels) starts_.push_back(start_of(grid));
  }

  static bool possible(const ChunkPlan& plan, const Grid& base, const std::vector<Grid>& levels) {
    const Grid* fine = &base;
    for (const Grid& grid : levels) {
      if (grid.window.lon_step != 2 * fine->window.lon_step) return false;
      fine = &grid;
    }
    // The longitude step of blocks is largest at the northern or southern end.
    for (int level = plan.coarsest_level(); level <= base.level; ++level)
      for (const std::int32_t lat : {extent_of(plan.node).lat0, extent_of(plan.node).lat1() - 1})
        if (extent_of(block_at(level, lat, extent_of(plan.node).lon0)).lon_step != grid_lon_step(plan.node, level))
          return false;
    return true;
  }

  Measured measured(const StopToken& stop) const {
    const int side = (extent_of(node_).lat1() - extent_of(node_).lat0) / base_.window.lat_step / tile_;
    std::vector<TileExtremes> tiles(static_cast<std::size_t>(side) * static_cast<std::size_t>(side));
    in_parallel(tiles.size(), [&](std::size_t i) {
      stop.check();
      tiles[i] = of_tile(static_cast<int>(i) / side * tile_, static_cast<int>(i) % side * tile_);
    });
    Measured found;
    for (const TileExtremes& tile : tiles) {
      for (const auto& [id, extremes] : tile.base) found[id].add(extremes);
      Extremes all;
      for (const auto& [id, extremes] : tile.base) all.add(extremes);
      for (std::size_t i = 0; i < levels_.size(); ++i) {
        Extremes& level = found[block_at(levels_[i].level, tile.lat, tile.lon)];
        level.add(all);
        level.add({tile.error_m[i], level.low, level.high});
      }
    }
    // A level may be lower and higher than what it is made of: where a void was left out, or a pole kept.
    for (auto& [id, extremes] : found)
      if (id.level < base_.level) {
        const Grid& grid = levels_[static_cast<std::size_t>(base_.level - 1 - id.level)];
        const Cut cut = cut_of(grid, id);
        extremes.add(range_of(grid, cut.r0, cut.c0, quads_per_side(id.level)));
      }
    return found;
  }

 private:
  static constexpr int kTile = 128;   // base posts: 64 KB of floats
  static constexpr int kOctaves = 6;  // that a tile's surface is refined by; a tile has two quads of that level

  struct TileExtremes {
    std::int32_t lat = 0, lon = 0;                   // of its south-west corner
    std::vector<std::pair<BlockId, Extremes>> base;  // of the blocks of posts
    std::vector<float> error_m;                      // by level
  };

  // What a tile's surface is refined from: the level's own posts over the node, or, where a tile is less than two of
  // its quads, those refined.
  struct Start {
    int octaves = 0;  // to the base
    int stride = 0;
    const float* posts = nullptr;  // of the node's south-west corner
    std::vector<float> refined;
  };

  Start start_of(const Grid& grid) const {
    Start start;
    start.octaves = base_.level - grid.level, start.stride = grid.window.cols;
    start.posts = grid.posts.heights.data() + grid.index(grid.halo, grid.halo);
    int quads = grid.window.rows - 1 - 2 * grid.halo;
    std::vector<float> finer;
    for (; start.octaves > kOctaves || (tile_ >> start.octaves) < 1; --start.octaves) {
      finer.resize(static_cast<std::size_t>(2 * quads + 1) * static_cast<std::size_t>(2 * quads + 1));
      refine_surface(start.posts, start.stride, quads, finer.data());
      start.refined.swap(finer);
      quads *= 2;
      start.posts = start.refined.data(), start.stride = quads + 1;
    }
    return start;
  }

  TileExtremes of_tile(int row, int col) const {
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
    const std::size_t most = static_cast<std::size_t>(tile_ + 1) * static_cast<std::size_t>(tile_ + 1);
    std::vector<float> one(most), other(most);
    for (std::size_t i = 0; i < starts_.size(); ++i) {
      const Start& start = starts_[i];
      const float* surface =
          start.posts + static_cast<std::ptrdiff_t>(row >> start.octaves) * start.stride + (col >> start.octaves);
      int stride = start.stride, n = tile_ >> start.octaves;
      for (int k = 0; k < start.octaves; ++k) {
        refine_surface(surface, stride, n, one.data());
        n *= 2, stride = n + 1, surface = one.data();
        one.swap(other);
      }
      tile.error_m[i] = largest_distance_in(base_, base_.halo + row, base_.halo + col, tile_, surface);
    }
    return tile;
  }

  BlockId node_;
  const Grid& base_;
  const std::vector<Grid>& levels_;
  int tile_;
  std::vector<Start> starts_;
};

std::vector<BlockId> blocks_of(const BlockId& node, int level) {
  std::vector<BlockId> level_blocks{node};
  if (level <= node.level) return {{level, node.row, node.col}};
  for (int n = node.level; n < level; ++n) {
    std::vector<BlockId> next;
    for (const BlockId& id : level_blocks)
      for (const BlockId& child : children_of(id)) next.push_back(child);
    level_blocks = std::move(next);
  }
  return level_blocks;
}

struct Encoded {
  Chunk::Record record;
  std::string bytes;
};

// Nothing but its bounds: a block of the posts themselves is read from their files.
Encoded bounds_of(const BlockId& id, const Extremes& extremes) {
  Encoded out;
  out.record.level = id.level, out.record.row = id.row, out.record.col = id.col;
  out.record.flags = extremes.low > extremes.high ? Chunk::Record::kEmpty : Chunk::Record::kFromSources;
  out.record.error_m = static_cast<double>(extremes.error_m);
  out.record.min_m = extremes.low, out.record.max_m = extremes.high;
  return out;
}

// The sources of a block's posts, row after row. Most blocks have one, those along the borders of tiles few in each
// row.
std::vector<format::Run> runs_of(const Grid& grid, const Cut& cut) {
  const int side = quads_per_side(cut.id.level) + 1;
  std::vector<format::Run> runs;
  for (int r = 0; r < side; ++r) {
    int c = 0;
    for (const SourceRun& run : grid.posts.sources.row(cut.r0 + r)) {
      if (run.past_last <= cut.c0 + c * cut.stride_c) continue;
      const int past = std::min(side, (run.past_last - cut.c0 + cut.stride_c - 1) / cut.stride_c);
      if (runs.empty() || runs.back().mark != run.mark) runs.push_back({run.mark, 0});
      runs.back().posts += static_cast<std::uint32_t>(past - c);
      c = past;
      if (c == side) break;
    }
  }
  return runs;
}

// Heights as steps of 16 bits above the lowest, where they reach, else as float32; then sources.
Encoded encode(const Grid& grid, const Cut& cut, const Extremes& extremes) {
  Encoded out = bounds_of(cut.id, extremes);
  const int side = quads_per_side(cut.id.level) + 1, wide = side + 2 * kHalo;
  std::vector<float> heights(static_cast<std::size_t>(wide) * static_cast<std::size_t>(wide));
  // The halo of a chunk's grid is as wide as that of its blocks at least.
  float* h = heights.data();
  for (int r = -kHalo; r < side + kHalo; ++r, h += wide) {
    const float* row = grid.row(cut.r0 + r) + cut.c0 - kHalo * cut.stride_c;
    if (cut.stride_c == 1)
      std::copy_n(row, wide, h);
    else
      for (int c = 0; c < wide; ++c) h[c] = row[c * cut.stride_c];
  }
  bool any = false;
  for (int r = 0; r < side && !any; ++r) {
    const float* row = heights.data() + (r + kHalo) * wide + kHalo;
    any = std::any_of(row, row + side, [](float v) { return !std::isnan(v); });
  }
  out.record.flags = any ? 0 : Chunk::Record::kEmpty;
  if (!any) return out;
  HeightRange range{std::numeric_limits<float>::max(), std::numeric_limits<float>::lowest()};
  extend_range(heights.data(), static_cast<int>(heights.size()), range);
  const float low = range.low, high = range.high;
  const float step = static_cast<float>(format::height_step_m(cut.id.level)), per_m = 1 / step;
  // A pole's height is no whole number of steps.
  const BlockExtent extent = extent_of(cut.id);
  const bool beside_pole = extent.lat0 == 0 || extent.lat1() == kLatTicks;
  if (!beside_pole && (high - low) * per_m < format::kVoidSteps) {
    out.record.flags |= Chunk::Record::kSteps;
    out.record.lowest_m = low;
    std::vector<std::uint16_t> steps(heights.size());
    std::transform(heights.begin(), heights.end(), steps.begin(), [&](float v) {
      return std::isnan(v) ? format::kVoidSteps : static_cast<std::uint16_t>(static_cast<int>((v - low) * per_m));
    });
    format::append(out.bytes, steps);
  } else {
    format::append(out.bytes, heights);
  }
  format::append(out.bytes, runs_of(grid, cut));
  out.record.size = out.bytes.size();
  out.record.checksum = XXH3_64bits(out.bytes.data(), out.bytes.size());
  return out;
}

Measured measure(const ChunkPlan& plan, const Grid& base, const std::vector<Grid>& levels, const StopToken& stop) {
  if (TileMeasurement::possible(plan, base, levels)) return TileMeasurement(plan, base, levels).measured(stop);
  Measured found;
  const auto add_level = [&](const Grid& grid) {
    const std::vector<BlockId> ids = blocks_of(plan.node, grid.level);
    std::vector<Extremes> extremes(ids.size());
    in_parallel(ids.size(), [&](std::size_t i) {
      stop.check();
      extremes[i] = measured_by_quads(grid, cut_of(grid, ids[i]), base);
    });
    for (std::size_t i = 0; i < ids.size(); ++i) found.emplace(ids[i], extremes[i]);
  };
  add_level(base);
  for (const Grid& grid : levels) add_level(grid);
  return found;
}

// The files that posts come from, ascending.
std::vector<SourceIndex> sources_of(const Grid& grid) {
  std::set<SourceIndex> found;
  SourceMark before = kNoSource;
  for (int r = 0; r < grid.window.rows; ++r)
    for (const SourceRun& run : grid.posts.sources.row(r))
      if (std::exchange(before, run.mark) != run.mark) found.insert(source_of(run.mark));
  found.erase(kNoSource);
  return {found.begin(), found.end()};
}

// Source numbers of the catalogue become the chunk's own, which survive a change of other files in the catalogue.
void localise(SourceRows& rows, const std::vector<SourceIndex>& sources) {
  for (int r = 0; r < rows.rows(); ++r)
    for (SourceRun& run : rows.row(r)) {
      const SourceIndex source = source_of(run.mark);
      if (source == kNoSource) continue;
      const auto local = std::lower_bound(sources.begin(), sources.end(), source) - sources.begin();
      run.mark = (run.mark & kMarkBits) | static_cast<SourceMark>(local);
    }
}

}  // namespace

std::vector<BlockId> Chunk::finer_blocks(const ChunkPlan& plan) {
  const PostWindow w = window_of(plan.node, plan.base_level, base_halo(plan));
  const std::int32_t side = quads_per_side(plan.base_level) * w.lat_step;
  const std::int64_t south = std::max<std::int64_t>(0, w.lat0),
                     north =
                         std::min<std::int64_t>(kLatTicks - 1, w.lat0 + static_cast<std::int64_t>(w.rows) * w.lat_step);
  std::vector<BlockId> ids;
  for (std::int64_t lat = south / side * side; lat <= north; lat += side) {
    const std::int64_t east = w.lon0 + static_cast<std::int64_t>(w.cols) * w.lon_step;
    for (std::int64_t lon = w.lon0; lon < east;) {
      ids.push_back(block_at(plan.base_level, static_cast<std::int32_t>(lat), wrap_lon(lon)));
      lon += extent_of(ids.back()).lon1() - wrap_lon(lon);
    }
  }
  return ids;
}

Chunk::Built Chunk::build(const ChunkPlan& plan, const Catalogue& catalogue, const PostSource& source,
                          const Finer& finer, const StopToken& stop, Scratch* kept) {
  LeftOut left_out;
  Scratch own;
  Scratch& scratch = kept ? *kept : own;
  Grid base =
      plan.direct ? direct_base(plan, source, scratch, stop) : base_from_finer(plan, finer, left_out, scratch, stop);
  const std::vector<SourceIndex> used = sources_of(base);
  std::vector<const RasterInfo*> sources;
  double quantisation_m = 0;
  for (const SourceIndex i : used) {
    sources.push_back(&catalogue.rasters()[i]);
    quantisation_m = std::max(quantisation_m, sources.back()->quantisation_m);
  }
  std::vector<Grid> levels;
  levels.reserve(static_cast<std::size_t>(base.level - plan.coarsest_level()));
  for (int n = base.level - 1; n >= plan.coarsest_level(); --n) {
    levels.push_back(coarser(plan.node, levels.empty() ? base : levels.back(), scratch, stop));
    if (levels.size() == 1) localise(levels.back().posts.sources, used);
  }
  const Measured measured = measure(plan, base, levels, stop);
  std::vector<Encoded> encoded;
  if (plan.direct)
    for (const BlockId& id : blocks_of(plan.node, base.level)) encoded.push_back(bounds_of(id, measured.at(id)));
  for (const Grid& grid : levels) {
    const std::vector<BlockId> ids = blocks_of(plan.node, grid.level);
    const std::size_t first = encoded.size();
    encoded.resize(first + ids.size());
    in_parallel(ids.size(), [&](std::size_t i) {
      stop.check();
      encoded[first + i] = encode(grid, cut_of(grid, ids[i]), measured.at(ids[i]));
    });
  }
  // The base of an indirect chunk is itself a band-limited surface: what it leaves out is added to the bounds.
  for (Encoded& e : encoded) {
    e.record.error_m += left_out.error_m;
    e.record.min_m -= left_out.below_m, e.record.max_m += left_out.above_m;
  }
  Built built{format::assemble(plan, quantisation_m, sources,
                               [&](auto&& each) {
                                 for (Encoded& e : encoded) each(e.record, e.bytes);
                               }),
              std::move(base.posts.replaced)};
  for (auto grid = levels.rbegin(); grid != levels.rend(); ++grid) scratch.give(std::move(grid->posts));
  scratch.give(std::move(base.posts));  // the last: the next build's first
  return built;
}

}  // namespace selenograph::dem
