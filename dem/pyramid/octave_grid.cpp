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

// Returns the height on a block's triangles within the quad whose south-west corner is (r, c). `t` and `u`: fractions
// of the quad's sides east and north of the corner.
float height_in_quad(const Block& block, int r, int c, float t, float u) {
  const int quads = block.extent.quads, north = std::min(r + 1, quads), east = std::min(c + 1, quads);
  const auto height = [&](int row, int col) { return block.vertices[block.index(row, col)].height_m; };
  // Read only the corners that a position on an edge needs: others may be void.
  if (u == 0) return t == 0 ? height(r, c) : height(r, c) + t * (height(r, east) - height(r, c));
  if (t == 0) return height(r, c) + u * (height(north, c) - height(r, c));
  if (t + u <= 1) return height(r, c) + t * (height(r, east) - height(r, c)) + u * (height(north, c) - height(r, c));
  return height(north, east) + (1 - t) * (height(north, c) - height(north, east)) +
         (1 - u) * (height(r, east) - height(north, east));
}

// Copies a finer chunk's block into the grid. If the block's posts are farther apart than the grid's (a coarser layer,
// or longitudes near a pole), heights between them are those of its triangles.
void paste(const Block& block, OctaveGrid& grid, std::vector<SourceMark>& marks) {
  const BlockExtent& e = block.extent;
  const PostWindow& w = grid.window;
  const int rows_per_post = std::max(steps_in(e.lat_step, w.lat_step), 1),
            columns_per_post = std::max(steps_in(e.lon_step, w.lon_step), 1);  // grid posts per block post, at least 1
  const std::int64_t row0 = (e.lat0 - w.lat0) / w.lat_step;                    // grid row of the block's southern edge
  const std::int64_t first_row = std::max<std::int64_t>(0, row0),
                     last_row = std::min<std::int64_t>(w.rows - 1, row0 + std::int64_t{e.quads} * rows_per_post);
  // Try all copies of the block around the globe that may lie in the window.
  const std::int64_t turn = std::llround(static_cast<double>(w.lon0 - e.lon0) / kLonTicks);
  for (const std::int64_t shift : {turn - 1, turn, turn + 1}) {
    const std::int64_t col0 = (e.lon0 + shift * kLonTicks - w.lon0) / w.lon_step;  // of its western edge
    const std::int64_t first_col = std::max<std::int64_t>(0, col0),
                       last_col = std::min<std::int64_t>(w.cols - 1, col0 + std::int64_t{e.quads} * columns_per_post);
    for (std::int64_t row = first_row; row <= last_row; ++row) {
      const auto r = static_cast<int>(row - row0);
      const float u = static_cast<float>(r % rows_per_post) / static_cast<float>(rows_per_post);
      for (std::int64_t col = first_col; col <= last_col; ++col) {
        const auto c = static_cast<int>(col - col0);
        const float t = static_cast<float>(c % columns_per_post) / static_cast<float>(columns_per_post);
        const std::size_t post = grid.index(static_cast<int>(row), static_cast<int>(col));
        grid.posts.heights[post] = height_in_quad(block, r / rows_per_post, c / columns_per_post, t, u);
        marks[post] = block.source(r / rows_per_post, c / columns_per_post);
      }
    }
  }
}

// Returns the weighted mean of the valid posts under the 3 x 3 binomial (weights 1, 2, 1 along each axis), or, without
// `along_row`, under its middle column. A void position stays void.
float filter_near_void(const OctaveGrid& fine, int r, int c, bool along_row) {
  if (std::isnan(fine.at(r, c))) return kNoHeight_m;
  float sum = 0, weight = 0;
  for (int y = -1; y <= 1; ++y)
    for (int x = along_row ? -1 : 0; x <= (along_row ? 1 : 0); ++x) {
      const float h = fine.at(r + y, c + x), w = (y ? 1.F : 2.F) * (x ? 1.F : 2.F);
      if (!std::isnan(h)) {
        sum += w * h;
        weight += w;
      }
    }
  return sum / weight;
}

// Filters one row of the next coarser level from row `fr` of the finer one, by the binomial 1, 2, 1 along columns and,
// where the longitude step doubles (step_c = 2), along rows. Rounds to the level's height step. `buffer` is reused from
// row to row.
void filter_row(const OctaveGrid& fine, int fr, int step_c, bool pole, const OctaveGrid& grid,
                std::vector<float>& buffer, float* out) {
  constexpr int kPad = 4;  // columns that the kernel reaches outside the finer grid, whose outermost column is repeated
  const int cols = fine.window.cols, n = grid.window.cols;
  buffer.resize(static_cast<std::size_t>(cols) + 2 * kPad);
  float* column = buffer.data() + kPad;  // per column of the finer grid: the row filtered along columns
  if (pole)
    std::copy_n(fine.row(fr), cols, column);
  else
    add_three_rows(fine.row(fr - 1), fine.row(fr), fine.row(fr + 1), cols, column);
  std::fill_n(buffer.data(), kPad, column[0]);
  std::fill_n(column + cols, kPad, column[cols - 1]);
  const float* first = column + fine.halo - step_c * grid.halo;  // finer column at the coarser grid's first one
  const auto step = static_cast<float>(format::height_step_m(grid.level));
  if (pole) {  // a pole is one point: keep its height unfiltered, so that all blocks around it agree
    for (int c = 0; c < n; ++c) out[c] = first[static_cast<std::ptrdiff_t>(step_c) * c];
    return;
  }
  if (step_c == 1)
    quantise_row(first, n, 0.25F, step, out);  // divides by the sum of the weights, 1 + 2 + 1
  else
    halve_row(first, n, step, out);
  // A void made its neighbours NaN: repeat those with the valid posts alone.
  for (int c = 0; c < n; ++c) {
    if (!std::isnan(out[c])) continue;
    const float h = filter_near_void(fine, fr, fine.halo + step_c * (c - grid.halo), step_c == 2);
    quantise_row(&h, 1, 1, step, out + c);
  }
}

// Copies the sources of the finer level's columns to the coarser row. Columns outside the finer grid get the source of
// its outermost one.
void coarser_sources(const OctaveGrid& fine, int fine_row, int step_c, OctaveGrid& grid, int row) {
  grid.posts.sources.clear(row);
  for (const SourceRun& run : fine.posts.sources.row(fine_row)) {
    // Round up to the first coarser column whose finer column lies after the run.
    const int past = run.past_last - fine.halo,
              column = grid.halo + (past >= 0 ? (past + step_c - 1) / step_c : -(-past / step_c));
    const bool last = run.past_last == fine.window.cols;
    grid.posts.sources.append(row, run.mark, last ? grid.window.cols : std::clamp(column, 0, grid.window.cols));
  }
}

}  // namespace

PostWindow window_of(const BlockId& node, int level, int halo) {
  const BlockExtent e = extent_of(node);
  PostWindow w;
  w.lat_step = Tick{1} << (kTickLevel - level);
  w.lon_step = grid_lon_step(node, level);
  w.lat0 = e.lat0 - halo * w.lat_step;
  w.lon0 = e.lon0 - halo * w.lon_step;
  w.rows = steps_in(e.lat1() - e.lat0, w.lat_step) + 1 + 2 * halo;
  w.cols = steps_in(e.lon1() - e.lon0, w.lon_step) + 1 + 2 * halo;
  return w;
}

int base_halo(const ChunkPlan& plan) { return (kHalo + 1) << (plan.base_level - plan.node.level); }

void LeftOut::add(const Block& block) {
  error_m = std::max(error_m, block.error_m);
  float low = std::numeric_limits<float>::max(), high = std::numeric_limits<float>::lowest();
  for (const Vertex& v : block.vertices)
    if (!std::isnan(v.height_m)) {
      low = std::min(low, v.height_m);
      high = std::max(high, v.height_m);
    }
  below_m = std::max(below_m, low - block.min_m);
  above_m = std::max(above_m, block.max_m - high);
}

OctaveGrid direct_base(const ChunkPlan& plan, const PostSource& source, Chunk::Scratch& scratch,
                       const StopToken& stop) {
  OctaveGrid grid{plan.base_level, base_halo(plan) + kFillReach, {}, scratch.take()};
  grid.window = window_of(plan.node, grid.level, grid.halo);
  source.compose_filled(grid.window, grid.posts, stop);
  return grid;
}

// Pastes the blocks of the finer chunks into a grid, and collects what they leave out.
OctaveGrid base_from_finer(const ChunkPlan& plan, const Chunk::Finer& finer, LeftOut& left_out, Chunk::Scratch& scratch,
                           const StopToken& stop) {
  OctaveGrid grid{plan.base_level, base_halo(plan), {}, scratch.take()};
  grid.window = window_of(plan.node, grid.level, grid.halo);
  grid.posts.heights.assign(grid.window.size(), kNoHeight_m);
  std::vector<SourceMark> marks(grid.window.size(), kNoSource);
  grid.posts.replaced = finer.replaced;
  std::unordered_set<const Block*>
      pasted;  // blocks already copied: a block of widely spaced posts stands under several ids
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

// Filters and halves the finer grid, in pieces of rows. Row r of the result lies on row `fr` of the finer grid.
OctaveGrid coarser(const BlockId& node, const OctaveGrid& fine, Chunk::Scratch& scratch, const StopToken& stop) {
  OctaveGrid grid{fine.level - 1, std::max(kHalo, (fine.halo - 1) / 2), {}, scratch.take()};
  grid.window = window_of(node, grid.level, grid.halo);
  const int step_c =
      steps_in(grid.window.lon_step, fine.window.lon_step);  // 1 if the longitude step is at its cap, else 2
  grid.posts.heights.resize(grid.window.size());
  grid.posts.sources.reset(grid.window.rows, grid.window.cols);
  constexpr std::size_t kRowsAtOnce = 16;
  in_parallel_pieces(static_cast<std::size_t>(grid.window.rows), kRowsAtOnce,
                     [&](std::size_t first, std::size_t past_last) {
                       std::vector<float> buffer;
                       for (std::size_t row = first; row < past_last; ++row) {
                         stop.check();
                         const int r = static_cast<int>(row), fr = fine.halo + 2 * (r - grid.halo);
                         const std::int64_t lat = grid.window.lat0 + r * grid.window.lat_step;
                         const bool pole = lat == 0 || lat == kLatTicks;
                         filter_row(fine, fr, step_c, pole, grid, buffer, grid.posts.heights.data() + grid.index(r, 0));
                         coarser_sources(fine, std::clamp(fr, 0, fine.window.rows - 1), step_c, grid, r);
                       }
                     });
  return grid;
}

BlockCut cut_of(const OctaveGrid& grid, const BlockId& id) {
  const BlockExtent e = extent_of(id);
  return {id, steps_in(e.lat0 - grid.window.lat0, grid.window.lat_step),
          steps_in(e.lon0 - grid.window.lon0, grid.window.lon_step), steps_in(e.lon_step, grid.window.lon_step)};
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
