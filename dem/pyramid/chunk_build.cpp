// Builds a chunk: composes posts, filters octave by octave, measures each block's error, encodes the blocks.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>
#include <utility>

#include "dem/base/hash.h"
#include "dem/base/parallel.h"
#include "dem/grid/shading_normals.h"
#include "dem/posts/post_kernels.h"
#include "dem/pyramid/block_error.h"
#include "dem/pyramid/block_posts.h"
#include "dem/pyramid/chunk.h"
#include "dem/pyramid/chunk_format.h"

namespace selenograph::dem {
namespace {

// Block as it is stored: index entry and bytes.
struct Encoded {
  Chunk::Record record;
  std::string bytes;
};

// Encodes the bounds of a block of posts: its heights are read from the source files.
Encoded bounds_of(const BlockId& id, const Extremes& extremes) {
  Encoded out;
  out.record.level = id.level;
  out.record.row = id.row;
  out.record.col = id.col;
  out.record.flags = extremes.low > extremes.high ? Chunk::Record::kEmpty : Chunk::Record::kFromSources;
  out.record.error_m = static_cast<double>(extremes.error_m);
  out.record.min_m = extremes.low;
  out.record.max_m = extremes.high;
  return out;
}

// Returns the sources of a block's posts as runs, row after row; `c` counts the block's columns, which are every
// cut.stride_c-th column of the grid. Most blocks have one run, those along the borders of
// tiles a few per row.
std::vector<format::Run> runs_of(const OctaveGrid& grid, const BlockCut& cut) {
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

// Encodes a filtered block: heights as 16-bit steps above the lowest one if these reach the highest, else as float32;
// then the sources.
Encoded encode(const OctaveGrid& grid, const BlockCut& cut, const Extremes& extremes) {
  Encoded out = bounds_of(cut.id, extremes);
  const int side = quads_per_side(cut.id.level) + 1, wide = side + 2 * kHalo;
  std::vector<float> heights(static_cast<std::size_t>(wide) * static_cast<std::size_t>(wide));
  // Copy the block with its halo: the halo of a chunk's grid is at least as wide.
  float* h = heights.data();
  for (int r = -kHalo; r < side + kHalo; ++r, h += wide) {
    const float* row = grid.row(cut.r0 + r) + cut.c0 - kHalo * cut.stride_c;
    if (cut.stride_c == 1)
      std::copy_n(row, wide, h);
    else
      for (int c = 0; c < wide; ++c) h[c] = row[c * cut.stride_c];
  }
  bool has_heights = false;  // in the block itself, without the halo
  for (int r = 0; r < side && !has_heights; ++r) {
    const float* row = heights.data() + (r + kHalo) * wide + kHalo;
    has_heights = std::any_of(row, row + side, [](float v) { return !std::isnan(v); });
  }
  out.record.flags = has_heights ? 0 : Chunk::Record::kEmpty;
  if (!has_heights) return out;
  HeightRange range{std::numeric_limits<float>::max(), std::numeric_limits<float>::lowest()};
  extend_range(heights.data(), static_cast<int>(heights.size()), range);
  const float low = range.low, high = range.high;
  const float step = static_cast<float>(format::height_step_m(cut.id.level)), per_m = 1 / step;
  // Store heights near a pole as float32: a pole's height is not filtered, so it is not a whole number of steps.
  const BlockExtent extent = extent_of(cut.id);
  const bool touches_pole = extent.lat0 == 0 || extent.lat1() == kLatTicks;
  if (!touches_pole && (high - low) * per_m < format::kVoidSteps) {
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
  out.record.checksum = hash_of(out.bytes.data(), out.bytes.size());
  return out;
}

// Returns the files that posts come from, ascending.
std::vector<SourceIndex> sources_of(const OctaveGrid& grid) {
  std::set<SourceIndex> found;
  SourceMark previous = kNoSource;  // mark of the run before: long borders repeat few marks
  for (int r = 0; r < grid.window.rows; ++r)
    for (const SourceRun& run : grid.posts.sources.row(r))
      if (std::exchange(previous, run.mark) != run.mark) found.insert(source_of(run.mark));
  found.erase(kNoSource);
  return {found.begin(), found.end()};
}

// Replaces the catalogue's source numbers by the chunk's own, which survive a change of other files in the catalogue.
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

// Walks the rows of blocks of the base level that the grid of base_from_finer(), with its halo, covers, from south to
// north. A window beyond the date line wraps.
std::vector<BlockId> Chunk::finer_blocks(const ChunkPlan& plan) {
  const PostWindow w = window_of(plan.node, plan.base_level, base_halo(plan));
  const Tick side = quads_per_side(plan.base_level) * w.lat_step;
  const std::int64_t south = std::max<std::int64_t>(0, w.lat0),
                     north = std::min<std::int64_t>(kLatTicks - 1, w.lat0 + w.rows * w.lat_step);
  std::vector<BlockId> ids;
  for (std::int64_t lat = south / side * side; lat <= north; lat += side) {
    const std::int64_t east = w.lon0 + w.cols * w.lon_step;
    for (std::int64_t lon = w.lon0; lon < east;) {
      ids.push_back(block_at(plan.base_level, lat, wrap_lon(lon)));
      lon += extent_of(ids.back()).lon1() - wrap_lon(lon);
    }
  }
  return ids;
}

// Composes the base, filters it octave by octave, measures all blocks against the base, and encodes them from fine to
// coarse. The base of a direct chunk stays in its files: only its blocks' bounds are stored.
Chunk::Built Chunk::build(const ChunkPlan& plan, const Catalogue& catalogue, const PostSource& source,
                          const Finer& finer, const StopToken& stop, Scratch* shared_scratch) {
  LeftOut left_out;
  Scratch own;
  Scratch& scratch = shared_scratch ? *shared_scratch : own;
  OctaveGrid base =
      plan.direct ? direct_base(plan, source, scratch, stop) : base_from_finer(plan, finer, left_out, scratch, stop);
  const std::vector<SourceIndex> used = sources_of(base);  // the chunk's own source numbers index this list
  std::vector<const RasterInfo*> sources;
  double quantisation_m = 0;
  for (const SourceIndex i : used) {
    sources.push_back(&catalogue.rasters()[i]);
    quantisation_m = std::max(quantisation_m, sources.back()->quantisation_m);
  }
  std::vector<OctaveGrid> levels;
  levels.reserve(static_cast<std::size_t>(base.level - plan.coarsest_level()));
  for (int n = base.level - 1; n >= plan.coarsest_level(); --n) {
    levels.push_back(coarser(plan.node, levels.empty() ? base : levels.back(), scratch, stop));
    // Renumber the first filtered level: coarser levels copy its marks.
    if (levels.size() == 1) localise(levels.back().posts.sources, used);
  }
  const BlockExtremes measured = measure_blocks(plan, base, levels, stop);
  std::vector<Encoded> encoded;
  if (plan.direct)
    for (const BlockId& id : blocks_of(plan.node, base.level)) encoded.push_back(bounds_of(id, measured.at(id)));
  for (const OctaveGrid& grid : levels) {
    const std::vector<BlockId> ids = blocks_of(plan.node, grid.level);
    const std::size_t first = encoded.size();
    encoded.resize(first + ids.size());
    in_parallel(ids.size(), [&](std::size_t i) {
      stop.check();
      encoded[first + i] = encode(grid, cut_of(grid, ids[i]), measured.at(ids[i]));
    });
  }
  // Widen the bounds of an indirect chunk by what its base leaves out: the base is itself a band-limited surface.
  for (Encoded& e : encoded) {
    e.record.error_m += left_out.error_m;
    e.record.min_m -= left_out.below_m;
    e.record.max_m += left_out.above_m;
  }
  Built built{format::assemble(plan, quantisation_m, sources,
                               [&](auto&& each) {
                                 for (Encoded& e : encoded) each(e.record, e.bytes);
                               }),
              std::move(base.posts.replaced)};
  for (auto grid = levels.rbegin(); grid != levels.rend(); ++grid) scratch.give(std::move(grid->posts));
  scratch.give(std::move(base.posts));  // give the base back last: the next build takes it first, for its own base
  return built;
}

}  // namespace selenograph::dem
