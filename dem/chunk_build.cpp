// Builds a chunk: composes posts, filters octave by octave, measures each block's error.
#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "dem/chunk.h"
#include "dem/chunk_format.h"
#include "dem/parallel.h"
#include "dem/shading_normals.h"

namespace selenograph::dem {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// Posts of one level over the chunk and a halo around it.
struct Grid {
  int level = 0;
  int halo = 0;  // posts beyond the chunk on each side
  PostWindow window;
  Posts posts;
  float at(int r, int c) const {
    r = std::clamp(r, 0, window.rows - 1), c = std::clamp(c, 0, window.cols - 1);
    return posts.heights[index(r, c)];
  }
  std::size_t index(int r, int c) const {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(window.cols) + static_cast<std::size_t>(c);
  }
};

// The longitude step of a level's grid: that of the chunk's rows nearest the equator, the finest that any block of it
// needs.
std::int32_t grid_lon_step(const BlockId& node, int level) {
  const BlockExtent e = extent_of(node);
  const std::int32_t nearest = std::clamp(kLatTicks / 2, e.lat0, e.lat1() - 1);
  return extent_of(block_at(level, nearest, e.lon0)).lon_step;
}

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

Grid direct_base(const ChunkPlan& plan, const PostSource& source, const StopToken& stop) {
  Grid grid{plan.base_level, base_halo(plan) + kFillReach, {}, {}};
  grid.window = window_of(plan.node, grid.level, grid.halo);
  grid.posts = source.compose(grid.window, stop);
  PostSource::fill_voids(grid.window, grid.posts, stop);
  return grid;
}

// Copies a finer chunk's top block into the grid. Near a pole its columns can be wider apart than the grid's: posts
// between are interpolated along the row.
void paste(const Block& block, Grid& grid) {
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
        const float ha = block.heights[block.index(r, a)], hb = block.heights[block.index(r, b)];
        const std::size_t at = grid.index(static_cast<int>(row), static_cast<int>(col));
        grid.posts.heights[at] = t == 0 ? ha : ha + t * (hb - ha);
        grid.posts.sources[at] = block.source(r, a);
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
    for (const float h : block.heights)
      if (!std::isnan(h)) low = std::min(low, h), high = std::max(high, h);
    below_m = std::max(below_m, low - block.min_m), above_m = std::max(above_m, block.max_m - high);
  }
};

Grid base_from_finer(const ChunkPlan& plan, const Chunk::Finer& finer, LeftOut& left_out, const StopToken& stop) {
  Grid grid{plan.base_level, base_halo(plan), {}, {}};
  grid.window = window_of(plan.node, grid.level, grid.halo);
  const std::size_t posts = grid.window.size();
  grid.posts = {std::vector<float>(posts, kNaN), std::vector<SourceMark>(posts, kNoSource), finer.replaced};
  for (const BlockId& id : Chunk::finer_blocks(plan)) {
    stop.check();
    if (const auto& block = finer.blocks.at(id)) {
      paste(*block, grid);
      left_out.add(*block);
    }
  }
  return grid;
}

// Weighted mean of the valid posts under the 3 x 3 binomial; a position that is void stays void.
float filtered_beside_voids(const Grid& fine, int r, int c, bool along_row) {
  if (std::isnan(fine.at(r, c))) return kNaN;
  float sum = 0, weight = 0;
  for (int y = -1; y <= 1; ++y)
    for (int x = along_row ? -1 : 0; x <= (along_row ? 1 : 0); ++x) {
      const float h = fine.at(r + y, c + x), w = (y ? 1.F : 2.F) * (x ? 1.F : 2.F);
      if (!std::isnan(h)) sum += w * h, weight += w;
    }
  return sum / weight;
}

Grid coarser(const BlockId& node, const Grid& fine, const StopToken& stop) {
  Grid grid{fine.level - 1, std::max(kHalo, (fine.halo - 1) / 2), {}, {}};
  grid.window = window_of(node, grid.level, grid.halo);
  const int step_c = grid.window.lon_step / fine.window.lon_step;  // 1 where the longitude step is at its cap
  grid.posts = {std::vector<float>(grid.window.size()), std::vector<SourceMark>(grid.window.size()), {}};
  const bool voids =
      std::any_of(fine.posts.heights.begin(), fine.posts.heights.end(), [](float h) { return std::isnan(h); });
  in_parallel(static_cast<std::size_t>(grid.window.rows), [&](std::size_t row) {
    stop.check();
    const int r = static_cast<int>(row);
    const int fr = fine.halo + 2 * (r - grid.halo);
    const std::int64_t lat = grid.window.lat0 + static_cast<std::int64_t>(r) * grid.window.lat_step;
    const bool pole = lat == 0 || lat == kLatTicks;  // one point: kept, so that every chunk around it agrees
    for (int c = 0; c < grid.window.cols; ++c) {
      const int fc = fine.halo + step_c * (c - grid.halo);
      float h = fine.at(fr, fc);
      if (!pole && voids) {
        h = filtered_beside_voids(fine, fr, fc, step_c == 2);
      } else if (!pole) {
        const auto column = [&](int x) { return fine.at(fr - 1, x) + 2 * fine.at(fr, x) + fine.at(fr + 1, x); };
        h = step_c == 2 ? (column(fc - 1) + 2 * column(fc) + column(fc + 1)) / 16 : column(fc) / 4;
      }
      grid.posts.heights[grid.index(r, c)] = h;
      const int sr = std::clamp(fr, 0, fine.window.rows - 1), sc = std::clamp(fc, 0, fine.window.cols - 1);
      grid.posts.sources[grid.index(r, c)] = fine.posts.sources[fine.index(sr, sc)];
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

// Largest vertical distance between a block's triangles and the base posts beneath. Linear in latitude and longitude
// within a triangle (the chord's sag over the sphere is accounted for separately: lattice.h, chord_sag_m); the diagonal
// runs from the south-east to the north-west corner, as in the rendered mesh.
void measure(const Grid& grid, const Cut& cut, const Grid& base, Chunk::Record& record) {
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
  record.error_m = static_cast<double>(worst);
  record.min_m = low, record.max_m = high;
}

struct Encoded {
  Chunk::Record record;
  std::string bytes;
};

// Heights as int16 when that loses nothing (integer metres: the posts themselves), else float32; then sources.
Encoded encode(const Grid& grid, const Cut& cut, const Grid& base) {
  Encoded out;
  out.record.level = cut.id.level, out.record.row = cut.id.row, out.record.col = cut.id.col;
  const int side = quads_per_side(cut.id.level) + 1, wide = side + 2 * kHalo;
  std::vector<float> heights;
  heights.reserve(static_cast<std::size_t>(wide) * static_cast<std::size_t>(wide));
  for (int r = -kHalo; r < side + kHalo; ++r)
    for (int c = -kHalo; c < side + kHalo; ++c) heights.push_back(grid.at(cut.r0 + r, cut.c0 + c * cut.stride_c));
  std::vector<SourceMark> sources;
  sources.reserve(static_cast<std::size_t>(side) * static_cast<std::size_t>(side));
  bool any = false;
  for (int r = 0; r < side; ++r)
    for (int c = 0; c < side; ++c) {
      any |= !std::isnan(grid.at(cut.r0 + r, cut.c0 + c * cut.stride_c));
      sources.push_back(grid.posts.sources[grid.index(cut.r0 + r, cut.c0 + c * cut.stride_c)]);
    }
  if (!any) {
    out.record.flags = Chunk::kEmpty;
    return out;
  }
  measure(grid, cut, base, out.record);
  const bool integers = std::all_of(heights.begin(), heights.end(), [](float h) {
    return std::isnan(h) || (h == std::rint(h) && std::abs(h) < 32000);
  });
  if (integers) {
    out.record.flags |= Chunk::kInt16;
    std::vector<std::int16_t> small;
    small.reserve(heights.size());
    for (const float h : heights) small.push_back(std::isnan(h) ? format::kVoid16 : static_cast<std::int16_t>(h));
    format::append(out.bytes, small);
  } else {
    format::append(out.bytes, heights);
  }
  if (std::all_of(sources.begin(), sources.end(), [&](SourceMark s) { return s == sources[0]; })) {
    out.record.flags |= Chunk::kUniformSource;
    sources.resize(1);
  }
  format::append(out.bytes, sources);
  out.record.size = out.bytes.size();
  out.record.checksum = XXH3_64bits(out.bytes.data(), out.bytes.size());
  return out;
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

void encode_level(const Grid& grid, const Grid& base, const BlockId& node, std::vector<Encoded>& out,
                  const StopToken& stop) {
  const std::vector<BlockId> ids = blocks_of(node, grid.level);
  const std::size_t first = out.size();
  out.resize(first + ids.size());
  in_parallel(ids.size(), [&](std::size_t i) {
    stop.check();
    out[first + i] = encode(grid, cut_of(grid, ids[i]), base);
  });
}

// Source numbers of the catalogue become the chunk's own, which survive a change of other files in the catalogue.
std::vector<const RasterInfo*> localise(Posts& posts, const Catalogue& catalogue) {
  std::vector<SourceIndex> local(catalogue.rasters().size(), kNoSource);
  std::vector<const RasterInfo*> sources;
  for (SourceMark& s : posts.sources) {
    const SourceIndex index = source_of(s);
    if (index == kNoSource) continue;
    if (local[index] == kNoSource) {
      local[index] = static_cast<SourceIndex>(sources.size());
      sources.push_back(&catalogue.rasters()[index]);
    }
    s = (s & kFilledBit) | local[index];
  }
  return sources;
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
                          const Finer& finer, const StopToken& stop) {
  LeftOut left_out;
  Grid base = plan.direct ? direct_base(plan, source, stop) : base_from_finer(plan, finer, left_out, stop);
  const std::vector<const RasterInfo*> sources = localise(base.posts, catalogue);
  double quantisation_m = 0;
  for (const RasterInfo* info : sources) quantisation_m = std::max(quantisation_m, info->quantisation_m);
  std::vector<Encoded> encoded;
  if (plan.direct) encode_level(base, base, plan.node, encoded, stop);
  Grid level;
  for (int n = base.level - 1; n >= plan.coarsest_level(); --n) {
    level = coarser(plan.node, n == base.level - 1 ? base : level, stop);
    encode_level(level, base, plan.node, encoded, stop);
  }
  // The base of an indirect chunk is itself a band-limited surface: what it leaves out is added to the bounds.
  for (Encoded& e : encoded) {
    e.record.error_m += left_out.error_m;
    e.record.min_m -= left_out.below_m, e.record.max_m += left_out.above_m;
  }
  return {format::assemble(plan, quantisation_m, sources,
                           [&](auto&& each) {
                             for (Encoded& e : encoded) each(e.record, e.bytes);
                           }),
          std::move(base.posts.replaced)};
}

}  // namespace selenograph::dem
