#include "dem/terrain/chunk_plans.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "dem/base/hash.h"
#include "dem/posts/level_borders.h"

namespace selenograph::dem {
namespace {

// Version of the chunk files. Increment it when the same sources give different files: old ones are then rebuilt.
//
// Every value named after a change of the past (kGapsClosed, kTwistCounted ...) does the same for only those chunks
// that the change altered, so that all others in users' cache folders stay valid.
constexpr std::uint64_t kFormatVersion = 7;

// Bounds of the distance beyond its border within which sources affect a chunk. Its posts may be up to 8 times as far
// apart in longitude as in latitude. A chunk built from finer chunks adds 2 degrees for those chunks' own margins.
constexpr int kMaxLonShift = 3, kMaxAspect = 1 << kMaxLonShift;
double halo_deg(const ChunkPlan& plan) {
  const double halo = 3 * std::ldexp(1.0, plan.base_level - plan.node.level) + kFillReach;
  return halo / std::ldexp(1.0, plan.base_level);
}
double margin_deg(const ChunkPlan& plan) { return kMaxAspect * halo_deg(plan) + (plan.direct ? 0 : 2); }

// Returns the ancestor of a block at the root level, or the block of that level with its area.
BlockId root_of(const BlockId& id) {
  return id.level <= kRootLevel ? BlockId{kRootLevel, id.row, id.col} : ancestor_of(id, kRootLevel);
}

}  // namespace

ChunkPlans::ChunkPlans(const Catalogue& catalogue, const PostSource& source, bool fall_through)
    : catalogue_(catalogue), source_(source), fall_through_(fall_through) {
  for (int row = 0; row < rows_of(0); ++row)
    for (int col = 0; col < columns_of(0, row); ++col)
      if (any_file_within(catalogue, {0, row, col})) roots_.push_back({0, row, col});
}

ChunkPlan ChunkPlans::plan(const ChunkNode& chunk) const {
  {
    std::lock_guard lock(mutex_);
    if (const auto found = plans_.find(chunk.node); found != plans_.end()) return found->second;
  }
  const ChunkPlan plan = make_plan(chunk);
  std::lock_guard lock(mutex_);
  return plans_.emplace(chunk.node, plan).first->second;
}

ChunkPlan ChunkPlans::make_plan(const ChunkNode& chunk) const {
  ChunkPlan plan;
  plan.node = chunk.node;
  const ChunkLevels& levels = chunk.levels;
  plan.exists = levels.exists;
  plan.direct = levels.direct;
  plan.base_level = levels.base_level;
  plan.fingerprint = fingerprint_of(plan);
  return plan;
}

// Hashes everything that determines a chunk's content: a chunk file with another fingerprint is built again.
std::uint64_t ChunkPlans::fingerprint_of(const ChunkPlan& plan) const {
  StreamedHash f;
  f.add(kFormatVersion);
  f.add(plan.node);
  f.add(plan.base_level);
  f.add(fall_through_);
  // Files of reals without a declared void: earlier versions mistook heights for radii where most posts were void.
  constexpr std::uint64_t kDatumOfValidPosts = 1;
  // Include the files around the chunk: the filter and the filling of voids read posts beyond its border.
  for (const int i : files_around(plan, margin_deg(plan))) {
    const RasterInfo& info = catalogue_.rasters()[static_cast<std::size_t>(i)];
    f.add_text(info.path);
    f.add(info.stamp);
    if (info.quantisation_m == 0 && !info.void_value) f.add(kDatumOfValidPosts);
  }
  if (!catalogue_.joins().offsets_m.empty() || !catalogue_.one_layer()) add_joins(plan, f);
  const std::vector<int> files = files_touching(catalogue_, plan.node, 0);
  // Gaps between the posts of adjacent files: earlier versions left them open.
  constexpr std::uint64_t kGapsClosed = 1;
  const auto is_coarser = [&](int i) {
    const auto& level = catalogue_.rasters()[static_cast<std::size_t>(i)].lattice_level;
    return level && *level < plan.base_level;
  };
  if (std::count_if(files.begin(), files.end(), is_coarser) > 1) f.add(kGapsClosed);
  if (source_.borders().any()) add_borders(plan, f);
  // Chunks beside poles: earlier versions assumed the same surface for levels finer than such posts.
  constexpr std::uint64_t kTwistCounted = 1;
  if (plan.base_level < kSmoothLevel) f.add(kTwistCounted);
  // A pole that no file holds: earlier versions filled it with the voids beside it.
  constexpr std::uint64_t kPolesFilled = 1;
  if (const BlockExtent e = extent_of(plan.node); e.lat0 == 0 || e.lat1() == kLatTicks) f.add(kPolesFilled);
  return f.digest();
}

// Adds the borders with coarser posts around a chunk, and a mark if its finer chunks may have such borders.
void ChunkPlans::add_borders(const ChunkPlan& plan, StreamedHash& f) const {
  // Earlier versions left a wall one post wide there; later ones divided coarse posts as finely as fine ones.
  constexpr std::uint64_t kLevelsJoined = 3;
  if (!plan.direct) f.add(kLevelsJoined);
  const BlockExtent e = extent_of(plan.node);
  const auto margin = static_cast<std::int64_t>(margin_deg(plan) * kTicksPerDegree);
  PostWindow w;
  w.lat_step = w.lon_step = 1 << (kTickLevel - plan.base_level);
  w.lat0 = e.lat0 - margin;
  w.lon0 = e.lon0 - margin;
  w.rows = static_cast<int>((e.lat1() - e.lat0 + 2 * margin) / w.lat_step) + 1;
  w.cols = static_cast<int>((e.lon1() - e.lon0 + 2 * margin) / w.lon_step) + 1;
  for (const LevelBorder& b : source_.borders().near(w))
    for (const std::int64_t number : {std::int64_t{b.along_parallel}, b.at, b.from, b.to, std::int64_t{b.level}})
      f.add(number);
}

// Adds the bands in which coarser layers are bent, the files' offsets, and the files that determine the steps along the
// bands' borders, for a chunk that a band reaches or whose files have an offset. Other chunks depend on none of these.
void ChunkPlans::add_joins(const ChunkPlan& plan, StreamedHash& f) const {
  // Earlier versions changed the finer layer's posts.
  constexpr std::uint64_t kCoarserBent = 1;
  const double margin = margin_deg(plan), widest_deg = catalogue_.one_layer() ? 0 : source_.bends().widest_band_deg();
  double band_deg = 0;
  for (const int i : files_around(plan, margin + kMaxAspect * widest_deg)) {
    const RasterInfo& info = catalogue_.rasters()[static_cast<std::size_t>(i)];
    const double offset_m = catalogue_.offset_m(i), band_posts = source_.bends().band_posts(i);
    if (offset_m == 0 && band_posts == 0) continue;
    f.add_text(info.path);
    f.add(info.stamp);
    f.add(offset_m);
    f.add(band_posts);
    band_deg = std::max(band_deg, band_posts * info.post_spacing_m / kMetresPerDegree);
  }
  if (band_deg == 0) return;
  f.add(kCoarserBent);
  // Search farther for the files from which steps are measured: coarser layers are bent themselves.
  for (const int i : files_around(plan, margin + 3 * kMaxAspect * band_deg)) {
    const RasterInfo& info = catalogue_.rasters()[static_cast<std::size_t>(i)];
    f.add_text(info.path);
    f.add(info.stamp);
    if (const double offset_m = catalogue_.offset_m(i); offset_m != 0) f.add(offset_m);
  }
}

// Returns the files within a margin of a chunk. Beside a pole, where posts are farther apart in longitude, the margin
// is wider in longitude.
std::vector<int> ChunkPlans::files_around(const ChunkPlan& plan, double margin) const {
  const BlockExtent e = extent_of(plan.node);
  const double poleward_deg = std::max(-lat_deg_of(e.lat0), lat_deg_of(e.lat1())) + margin;
  const BlockId nearest =
      block_at(plan.base_level, static_cast<Tick>((90 + std::min(90.0, poleward_deg)) * kTicksPerDegree), 0);
  const int extra_shift = std::max(0, lon_shift(plan.base_level, nearest.row) - kMaxLonShift);
  const double extra_lon_deg = std::ldexp(margin, extra_shift) - margin;
  return catalogue_.touching(lat_deg_of(e.lat0), lat_deg_of(e.lat1()), lon_deg_of(e.lon0) - extra_lon_deg,
                             lon_deg_of(e.lon1()) + extra_lon_deg, margin);
}

ChunkPlan ChunkPlans::plan_for(const BlockId& id) const { return plan(source_.borders().chunk_of(id)); }

bool ChunkPlans::has_data(const BlockId& id) const {
  // At the root level and above it a block is its root's area.
  return source_.borders().levels_of(root_of(id)).exists && (id.level <= kRootLevel || any_file_within(catalogue_, id));
}

int ChunkPlans::posts_level(const BlockId& id) const {
  const ChunkLevels levels = source_.borders().chunk_of(id).levels;
  if (!levels.exists) return 0;
  if (levels.direct) return levels.base_level;
  int needed = levels.base_level;
  for (const int i : files_touching(catalogue_, id, 0))
    needed = std::max(needed, source_.borders().level_of_file(static_cast<std::size_t>(i)));
  return needed;
}

std::vector<ChunkPlan> ChunkPlans::all_plans() const {
  std::vector<ChunkPlan> found;
  for (const BlockId& root : roots_) add_with_finer(root_of(root), found);
  return found;
}

// Appends the chunks whose nodes are a block or its descendants, descendants first.
void ChunkPlans::add_with_finer(const BlockId& id, std::vector<ChunkPlan>& found) const {
  const ChunkNode chunk = source_.borders().chunk_of(id);
  if (!chunk.levels.exists) return;
  if (!chunk.levels.direct)
    for (const BlockId& child : children_of(id)) add_with_finer(child, found);
  if (chunk.node == id) found.push_back(plan(chunk));
}

}  // namespace selenograph::dem
