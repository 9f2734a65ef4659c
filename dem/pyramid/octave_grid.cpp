#include "dem/pyramid/octave_grid.h"

#include <cmath>
#include <limits>
#include <unordered_set>

#include "dem/base/parallel.h"
#include "dem/grid/shading_normals.h"
#include "dem/posts/post_kernels.h"
#include "dem/pyramid/block_posts.h"
#include "dem/pyramid/chunk_format.h"

namespace selenograph::dem {

namespace {

// A height within a quad of a block, `t` and `u` of its sides east and north of its corner (r, c): on its triangles.
float height_within(const Block& block, int r, int c, float t, float u) {
  const int quads = block.extent.quads, north = std::min(r + 1, quads), east = std::min(c + 1, quads);
  const auto at = [&](int row, int col) { return block.vertices[block.index(row, col)].height_m; };
  if (u == 0) return t == 0 ? at(r, c) : at(r, c) + t * (at(r, east) - at(r, c));
  if (t == 0) return at(r, c) + u * (at(north, c) - at(r, c));
  if (t + u <= 1) return at(r, c) + t * (at(r, east) - at(r, c)) + u * (at(north, c) - at(r, c));
  return at(north, east) + (1 - t) * (at(north, c) - at(north, east)) + (1 - u) * (at(r, east) - at(north, east));
}

// Copies a finer chunk's block into the grid. Its posts can be farther apart than the grid's, those of a coarser layer
// or, near a pole, in longitude: heights between are those of its triangles.
void paste(const Block& block, OctaveGrid& grid, std::vector<SourceMark>& marks) {
  const BlockExtent& e = block.extent;
  const PostWindow& w = grid.window;
  const int along = std::max(e.lat_step / w.lat_step, 1), across = std::max(e.lon_step / w.lon_step, 1);  // never less
  const std::int64_t row0 = (e.lat0 - w.lat0) / w.lat_step;
  const std::int64_t first_row = std::max<std::int64_t>(0, row0),
                     last_row = std::min<std::int64_t>(w.rows - 1, row0 + std::int64_t{e.quads} * along);
  const std::int64_t turn = std::llround(static_cast<double>(w.lon0 - e.lon0) / kLonTicks);
  for (const std::int64_t shift : {turn - 1, turn, turn + 1}) {
    const std::int64_t col0 = (e.lon0 + shift * kLonTicks - w.lon0) / w.lon_step;
    const std::int64_t first_col = std::max<std::int64_t>(0, col0),
                       last_col = std::min<std::int64_t>(w.cols - 1, col0 + std::int64_t{e.quads} * across);
    for (std::int64_t row = first_row; row <= last_row; ++row) {
      const auto r = static_cast<int>(row - row0);
      const float u = static_cast<float>(r % along) / static_cast<float>(along);
      for (std::int64_t col = first_col; col <= last_col; ++col) {
        const auto c = static_cast<int>(col - col0);
        const float t = static_cast<float>(c % across) / static_cast<float>(across);
        const std::size_t at = grid.index(static_cast<int>(row), static_cast<int>(col));
        grid.posts.heights[at] = height_within(block, r / along, c / across, t, u);
        marks[at] = block.source(r / along, c / across);
      }
    }
  }
}

// Weighted mean of the valid posts under the 3 x 3 binomial; a position that is void stays void.
float filtered_beside_voids(const OctaveGrid& fine, int r, int c, bool along_row) {
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
void filter_row(const OctaveGrid& fine, int fr, int step_c, bool pole, const OctaveGrid& grid,
                std::vector<float>& buffer, float* out) {
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
void coarser_sources(const OctaveGrid& fine, int fine_row, int step_c, OctaveGrid& grid, int row) {
  grid.posts.sources.clear(row);
  for (const SourceRun& run : fine.posts.sources.row(fine_row)) {
    // The first column that looks beyond the run.
    const int beyond = run.past_last - fine.halo,
              column = grid.halo + (beyond >= 0 ? (beyond + step_c - 1) / step_c : -(-beyond / step_c));
    const bool last = run.past_last == fine.window.cols;
    grid.posts.sources.append(row, run.mark, last ? grid.window.cols : std::clamp(column, 0, grid.window.cols));
  }
}

}  // namespace

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

int base_halo(const ChunkPlan& plan) { return (kHalo + 1) << (plan.base_level - plan.node.level); }

void LeftOut::add(const Block& block) {
  error_m = std::max(error_m, block.error_m);
  float low = std::numeric_limits<float>::max(), high = std::numeric_limits<float>::lowest();
  for (const Vertex& v : block.vertices)
    if (!std::isnan(v.height_m)) low = std::min(low, v.height_m), high = std::max(high, v.height_m);
  below_m = std::max(below_m, low - block.min_m), above_m = std::max(above_m, block.max_m - high);
}

OctaveGrid direct_base(const ChunkPlan& plan, const PostSource& source, Chunk::Scratch& scratch,
                       const StopToken& stop) {
  OctaveGrid grid{plan.base_level, base_halo(plan) + kFillReach, {}, scratch.take()};
  grid.window = window_of(plan.node, grid.level, grid.halo);
  source.compose_filled(grid.window, grid.posts, stop);
  return grid;
}

OctaveGrid base_from_finer(const ChunkPlan& plan, const Chunk::Finer& finer, LeftOut& left_out, Chunk::Scratch& scratch,
                           const StopToken& stop) {
  OctaveGrid grid{plan.base_level, base_halo(plan), {}, scratch.take()};
  grid.window = window_of(plan.node, grid.level, grid.halo);
  grid.posts.heights.assign(grid.window.size(), kNoHeight_m);
  std::vector<SourceMark> marks(grid.window.size(), kNoSource);
  grid.posts.replaced = finer.replaced;
  std::unordered_set<const Block*> pasted;  // posts that are farther apart stand in several places
  for (const BlockId& id : Chunk::finer_blocks(plan)) {
    stop.check();
    const auto& block = finer.blocks.at(id);
    if (!block || !pasted.insert(block.get()).second) continue;
    paste(*block, grid, marks);
    left_out.add(*block);
  }
  grid.posts.sources.reset(grid.window.rows, grid.window.cols);
  for (int r = 0; r < grid.window.rows; ++r) grid.posts.sources.set(r, marks.data() + grid.index(r, 0));
  return grid;
}

OctaveGrid coarser(const BlockId& node, const OctaveGrid& fine, Chunk::Scratch& scratch, const StopToken& stop) {
  OctaveGrid grid{fine.level - 1, std::max(kHalo, (fine.halo - 1) / 2), {}, scratch.take()};
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

BlockCut cut_of(const OctaveGrid& grid, const BlockId& id) {
  const BlockExtent e = extent_of(id);
  return {id, static_cast<int>((e.lat0 - grid.window.lat0) / grid.window.lat_step),
          static_cast<int>((e.lon0 - grid.window.lon0) / grid.window.lon_step), e.lon_step / grid.window.lon_step};
}

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

}  // namespace selenograph::dem
