#include "dem/terrain/chunk_plans.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "dem/base/hash.h"
#include "dem/posts/level_borders.h"

namespace selenograph::dem {
namespace {

// Raised when the same sources give other files: those in cache folders are then built anew.
constexpr std::uint64_t kFormatVersion = 7;

// How far beyond its border a chunk's content depends on sources, at most, where its posts are up to 8 times as far
// apart in longitude as in latitude. Finer chunks look beyond their own borders, too.
constexpr int kWidestShift = 3, kWidest = 1 << kWidestShift;
double halo_deg(const ChunkPlan& plan) {
  const double halo = 3 * std::ldexp(1.0, plan.base_level - plan.node.level) + kFillReach;
  return halo / std::ldexp(1.0, plan.base_level);
}
double margin_deg(const ChunkPlan& plan) { return kWidest * halo_deg(plan) + (plan.direct ? 0 : 2); }

// The block of the root level that a block is in, or is.
BlockId root_of(const BlockId& id) {
  return id.level <= kRootLevel ? BlockId{kRootLevel, id.row, id.col} : ancestor_of(id, kRootLevel);
}

}  // namespace

ChunkPlans::ChunkPlans(const Catalogue& catalogue, const PostSource& source, bool fall_through)
    : catalogue_(catalogue),
      source_(source),
      fall_through_(fall_through),
      any_on_network_(std::any_of(catalogue.rasters().begin(), catalogue.rasters().end(),
                                  [](const RasterInfo& info) { return info.on_network; })) {
  for (int row = 0; row < rows_of(0); ++row)
    for (int col = 0; col < columns_of(0, row); ++col)
      if (any_file_within(catalogue, {0, row, col})) roots_.push_back({0, row, col});
}

ChunkPlan ChunkPlans::plan(const ChunkNode& chunk) const {
  {
    std::lock_guard lock(mutex_);
    if (const auto found = plans_.find(chunk.node); found != plans_.end()) return found->second;
  }
  const ChunkPlan made = make_plan(chunk);
  std::lock_guard lock(mutex_);
  return plans_.emplace(chunk.node, made).first->second;
}

ChunkPlan ChunkPlans::make_plan(const ChunkNode& chunk) const {
  ChunkPlan plan;
  plan.node = chunk.node;
  const ChunkLevels& levels = chunk.levels;
  plan.exists = levels.exists, plan.direct = levels.direct, plan.base_level = levels.base_level;
  plan.on_network = touches_network(chunk.node, halo_deg(plan));
  plan.fingerprint = fingerprint_of(plan);
  return plan;
}

std::uint64_t ChunkPlans::fingerprint_of(const ChunkPlan& plan) const {
  StreamedHash f;
  f.add(kFormatVersion);
  f.add(plan.node);
  f.add(plan.base_level);
  f.add(fall_through_);
  // Of reals without a declared void: earlier versions took heights for radii where most posts were void.
  constexpr std::uint64_t kDatumOfValidPosts = 1;
  // Context beyond the border (filter and void filling) comes from the neighbours.
  for (const int i : around(plan, margin_deg(plan))) {
    const RasterInfo& info = catalogue_.rasters()[static_cast<std::size_t>(i)];
    f.add_text(info.path);
    f.add(info.stamp);
    if (info.quantisation_m == 0 && !info.void_value) f.add(kDatumOfValidPosts);
  }
  if (!catalogue_.joins().offsets_m.empty() || !catalogue_.one_layer()) add_joins(plan, f);
  const std::vector<int> layers = files_touching(catalogue_, plan.node, 0);
  // Between posts of tiles: earlier versions left the gaps between them open.
  constexpr std::uint64_t kGapsClosed = 1;
  const auto is_coarser = [&](int i) {
    const auto& level = catalogue_.rasters()[static_cast<std::size_t>(i)].lattice_level;
    return level && *level < plan.base_level;
  };
  if (std::count_if(layers.begin(), layers.end(), is_coarser) > 1) f.add(kGapsClosed);
  if (source_.borders().any()) add_borders(plan, f);
  // Beside poles: earlier versions took what is finer than such posts for the same surface.
  constexpr std::uint64_t kTwistCounted = 1;
  if (plan.base_level < kSmoothLevel) f.add(kTwistCounted);
  // At a pole that no file holds: earlier versions left it to the filling of voids where one was beside it.
  constexpr std::uint64_t kPolesFilled = 1;
  if (const BlockExtent e = extent_of(plan.node); e.lat0 == 0 || e.lat1() == kLatTicks) f.add(kPolesFilled);
  return f.digest();
}

// The coarser posts beside a chunk, and a mark where there may be such beside the finer chunks that it is made of.
void ChunkPlans::add_borders(const ChunkPlan& plan, StreamedHash& f) const {
  // Earlier versions left a wall one post wide, then divided coarse posts as finely as fine ones.
  constexpr std::uint64_t kLevelsJoined = 3;
  if (!plan.direct) f.add(kLevelsJoined);
  const BlockExtent e = extent_of(plan.node);
  const auto margin = static_cast<std::int64_t>(margin_deg(plan) * kTicksPerDegree);
  PostWindow w;
  w.lat_step = w.lon_step = 1 << (kTickLevel - plan.base_level);
  w.lat0 = e.lat0 - margin, w.lon0 = e.lon0 - margin;
  w.rows = static_cast<int>((e.lat1() - e.lat0 + 2 * margin) / w.lat_step) + 1;
  w.cols = static_cast<int>((e.lon1() - e.lon0 + 2 * margin) / w.lon_step) + 1;
  for (const LevelBorder& b : source_.borders().near(w))
    for (const std::int64_t number : {std::int64_t{b.along_parallel}, b.at, b.from, b.to, std::int64_t{b.level}})
      f.add(number);
}

// What a chunk that a band reaches, or in which files have an offset, depends on besides: the bands, and the files that
// determine the steps along their borders. A chunk that none reaches depends on nothing of it.
void ChunkPlans::add_joins(const ChunkPlan& plan, StreamedHash& f) const {
  // Earlier versions changed the finer layer's posts.
  constexpr std::uint64_t kCoarserBent = 1;
  const double margin = margin_deg(plan), widest_deg = catalogue_.one_layer() ? 0 : source_.bends().widest_band_deg();
  double band_deg = 0;
  for (const int i : around(plan, margin + kWidest * widest_deg)) {
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
  // A step is measured from coarser layers that are bent themselves.
  for (const int i : around(plan, margin + 3 * kWidest * band_deg)) {
    const RasterInfo& info = catalogue_.rasters()[static_cast<std::size_t>(i)];
    f.add_text(info.path);
    f.add(info.stamp);
    if (const double offset_m = catalogue_.offset_m(i); offset_m != 0) f.add(offset_m);
  }
}

// Those no farther from a chunk than a margin, which is of more longitude next to a pole.
std::vector<int> ChunkPlans::around(const ChunkPlan& plan, double margin) const {
  const BlockExtent e = extent_of(plan.node);
  const double poleward_deg = std::max(-lat_deg_of(e.lat0), lat_deg_of(e.lat1())) + margin;
  const BlockId nearest =
      block_at(plan.base_level, static_cast<std::int32_t>((90 + std::min(90.0, poleward_deg)) * kTicksPerDegree), 0);
  const int more = std::max(0, lon_shift(plan.base_level, nearest.row) - kWidestShift);
  const double beside_deg = std::ldexp(margin, more) - margin;
  return catalogue_.touching(lat_deg_of(e.lat0), lat_deg_of(e.lat1()), lon_deg_of(e.lon0) - beside_deg,
                             lon_deg_of(e.lon1()) + beside_deg, margin);
}

// Whether a file that lies within a block and so far around it, in degrees of latitude, is on a network.
bool ChunkPlans::touches_network(const BlockId& id, double around_deg) const {
  if (!any_on_network_) return false;
  const BlockExtent e = extent_of(id);
  const std::vector<int> files = files_touching(catalogue_, id, around_deg * e.lon_step / e.lat_step);
  return std::any_of(files.begin(), files.end(),
                     [&](int i) { return catalogue_.rasters()[static_cast<std::size_t>(i)].on_network; });
}

bool ChunkPlans::reads_network(const BlockId& id) const {
  if (!any_on_network_) return false;
  const ChunkPlan found = plan_for(id);
  return found.direct && id.level >= found.base_level &&
         touches_network(id, kFillReach / std::ldexp(1.0, found.base_level));
}

ChunkPlan ChunkPlans::plan_for(const BlockId& id) const { return plan(source_.borders().chunk_of(id)); }

bool ChunkPlans::has_data(const BlockId& id) const {
  // At the root level and above it a block is its root's area.
  return source_.borders().levels_of(root_of(id)).exists && (id.level <= kRootLevel || any_file_within(catalogue_, id));
}

int ChunkPlans::posts_level(const BlockId& id) const {
  const ChunkLevels here = source_.borders().chunk_of(id).levels;
  if (!here.exists) return 0;
  if (here.direct) return here.base_level;
  int needed = here.base_level;
  for (const int i : files_touching(catalogue_, id, 0))
    needed = std::max(needed, source_.borders().level_of_file(static_cast<std::size_t>(i)));
  return needed;
}

std::vector<ChunkPlan> ChunkPlans::all() const {
  std::vector<ChunkPlan> found;
  for (const BlockId& root : roots_) add_with_finer(root_of(root), found);
  return found;
}

// The chunks whose nodes are a block or within it.
void ChunkPlans::add_with_finer(const BlockId& id, std::vector<ChunkPlan>& found) const {
  const ChunkNode chunk = source_.borders().chunk_of(id);
  if (!chunk.levels.exists) return;
  if (!chunk.levels.direct)
    for (const BlockId& child : children_of(id)) add_with_finer(child, found);
  if (chunk.node == id) found.push_back(plan(chunk));
}

}  // namespace selenograph::dem
