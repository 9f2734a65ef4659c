#include "dem/terrain/pyramid_terrain.h"

#include <algorithm>
#include <atomic>
#include <mutex>
#include <stdexcept>
#include <unordered_map>
#include <utility>

#include "dem/base/error.h"
#include "dem/base/parallel.h"
#include "dem/base/wait_clock.h"
#include "dem/terrain/block_store.h"
#include "dem/terrain/chunk_plans.h"
#include "dem/terrain/chunk_store.h"
#include "dem/terrain/height_survey.h"
#include "dem/terrain/subdivided.h"
#include "dem/terrain/trouble_log.h"

namespace selenograph::dem {

struct PyramidTerrain::Impl {
  Impl(Catalogue c, const TerrainOptions& options)
      : catalogue(std::move(c)),
        trouble(options.log, options.cache_dir),
        source(catalogue, options.fall_through,
               [this](const std::string& file, const std::string& text) { trouble.warn(file, text); }),
        plans(catalogue, source, options.fall_through),
        // Protect an eighth of the budget for the latest blocks: cached scenes hold blocks in use, which must not evict
        // those of the current frame.
        blocks(options.cache_bytes / 4 * 3, {}, options.cache_bytes / 8),
        store(catalogue, source, plans, trouble, options, options.cache_bytes / 4) {
    // A file that cannot be catalogued may lie anywhere, so that any answer may lack it: refuse it or warn now.
    for (const CatalogueProblem& problem : catalogue.problems()) {
      if (problem.located || problem.unrelated) continue;
      if (!options.fall_through) throw DataError(problem.path, problem.what);
      trouble.warn(problem.path, problem.path + ": " + problem.what);
    }
    store.open_folder();
    if (options.ground_disk_bytes > 0 && !options.cache_dir.empty())
      ground = std::make_unique<BlockStore>(options.cache_dir + "/ground", options.ground_disk_bytes, trouble);
  }

  // Returns a block from the cache. On a miss one caller loads it, and the others wait for its flight.
  std::shared_ptr<const Block> load_once(const PyramidTerrain& terrain, const BlockId& id, const ChunkPlan& plan,
                                         const StopToken& stop) {
    return blocks.get(
        id,
        [&] {
          std::shared_ptr<const Block> block =
              id.level > plan.finest_level() ? subdivided_posts(terrain, id, plan, stop) : store.load(id, plan, stop);
          const std::size_t bytes = block ? block->bytes() : sizeof(Block);  // null is cached, too: without data
          return BlockCache::Loaded{std::move(block), bytes};
        },
        stop);
  }

  // Returns a block finer than the posts.
  std::shared_ptr<const Block> subdivided_posts(const PyramidTerrain& terrain, const BlockId& id, const ChunkPlan& plan,
                                                const StopToken& stop) {
    const auto posts = terrain.block(ancestor_of(id, plan.base_level), stop);
    return posts ? subdivided(*posts, id) : nullptr;
  }

  // Returns the bounds of a survey of the files, cached.
  std::optional<HeightRange> survey(const BlockId& id, const StopToken& stop) {
    {
      const std::lock_guard lock(mutex);
      if (const auto hit = surveys.find(id); hit != surveys.end()) return hit->second;
    }
    const Waiting waiting(stop.waits(), &Waits::pyramid);
    const std::optional<HeightRange> range = survey_heights(catalogue, source, id, stop);
    const std::lock_guard lock(mutex);
    if (surveys.size() >= kMaxSurveys) surveys.clear();
    surveys[id] = range;
    return range;
  }

  Catalogue catalogue;
  TroubleLog trouble;
  PostSource source;
  ChunkPlans plans;
  BlockCache blocks;
  std::unique_ptr<BlockStore> ground;
  std::atomic<int> details{0};  // number of terrains with detail created so far
  std::mutex mutex;             // guards surveys
  static constexpr std::size_t kMaxSurveys = 4096;
  std::unordered_map<BlockId, std::optional<HeightRange>, BlockIdHash> surveys;
  ChunkStore store;  // declared last: its threads use all of the above
};

PyramidTerrain::PyramidTerrain(Catalogue catalogue, const TerrainOptions& options)
    : impl_(std::make_unique<Impl>(std::move(catalogue), options)) {}
PyramidTerrain::~PyramidTerrain() = default;

const Catalogue& PyramidTerrain::catalogue() const { return impl_->catalogue; }
const PostSource& PyramidTerrain::post_source() const { return impl_->source; }
const std::vector<BlockId>& PyramidTerrain::roots() const { return impl_->plans.roots(); }
bool PyramidTerrain::has_data(const BlockId& id) const { return impl_->plans.has_data(id); }
int PyramidTerrain::posts_level(const BlockId& id) const { return impl_->plans.posts_level(id); }
bool PyramidTerrain::node_is_cheap(const BlockId& id) const { return impl_->plans.plan_for(id).direct; }

// Reads the bounds from the index of the node's chunk. A block finer than the posts has those of the block of posts.
NodeInfo PyramidTerrain::node(const BlockId& id, const StopToken& stop) const {
  const ChunkPlan plan = impl_->plans.plan_for(id);
  if (!plan.exists) return {};
  const bool finer_than_posts = id.level > plan.finest_level();
  const auto chunk = impl_->store.get(plan, stop);
  const Chunk::Record* record = chunk->find(finer_than_posts ? ancestor_of(id, plan.finest_level()) : id);
  if (!record) throw DataError("pyramid " + to_string(plan.node), "block " + to_string(id) + " is missing");
  // The error of a level finer than the posts comes from its quads' twist, which halves with each level
  // (block_error.h).
  const double error_m = id.level >= kSmoothLevel && finer_than_posts
                             ? 0
                             : std::ldexp(record->error_m, std::min(plan.finest_level() - id.level, 0));
  return {error_m, record->min_m, record->max_m, (record->flags & Chunk::Record::kEmpty) != 0, chunk->replaced()};
}

std::optional<HeightRange> PyramidTerrain::heights_without_building(const BlockId& id, const StopToken& stop) const {
  const ChunkPlan plan = impl_->plans.plan_for(id);
  if (!plan.exists || !plan.direct || impl_->store.has(plan)) return std::nullopt;
  return impl_->survey(id, stop);
}

std::shared_ptr<const Block> PyramidTerrain::block(const BlockId& id, const StopToken& stop) const {
  const ChunkPlan found = impl_->plans.plan_for(id);
  if (!found.exists) return nullptr;
  if (const auto hit = impl_->blocks.find(id)) return *hit;
  // Wait for the pyramid outside the arena: building it may take seconds, and the arena has few slots. Hold the chunk,
  // so that the cache does not evict it before the block is loaded.
  const std::shared_ptr<const Chunk> ready = impl_->store.get(found, stop);
  // Enter the arena before the single-flight load, whose loops need a slot. Other loop bodies wait for the same flight
  // and keep their slots meanwhile. A loader that started its flight first could wait for a slot that they hold.
  std::shared_ptr<const Block> block;
  where_loops_run([&] { block = impl_->load_once(*this, id, found, stop); });
  return block;
}

bool PyramidTerrain::has_replacements() const { return impl_->store.has_replacements(); }

BlockCache& PyramidTerrain::blocks() const { return impl_->blocks; }
BlockStore* PyramidTerrain::block_store() const { return impl_->ground.get(); }
int PyramidTerrain::new_detail_number() const { return ++impl_->details; }

void PyramidTerrain::stop_building() const { impl_->store.stop_building(); }
std::vector<std::string> PyramidTerrain::warnings() const { return impl_->trouble.warnings(); }
std::string PyramidTerrain::cache_trouble() const { return impl_->trouble.cache_trouble(); }

CacheStatistics PyramidTerrain::statistics() const {
  const BlockCache& blocks = impl_->blocks;
  CacheStatistics s = impl_->store.statistics();
  s.bytes += blocks.bytes();
  s.capacity_bytes += blocks.capacity();
  s.hits = blocks.hits();
  s.misses = blocks.misses();
  s.evictions += blocks.evictions();
  return s;
}

void PyramidTerrain::ingest(const Progress& progress) const {
  const std::vector<ChunkPlan> chunks = impl_->plans.all_plans();
  for (std::size_t i = 0; i < chunks.size() && impl_->store.unwritten().empty(); ++i) {
    impl_->store.get(chunks[i], {});
    if (!progress(i + 1, chunks.size(), to_string(chunks[i].node))) break;
  }
  wait_until_written();
  if (const std::string why = impl_->store.unwritten(); !why.empty()) throw std::runtime_error(why);
}

void PyramidTerrain::wait_until_written() const { impl_->store.wait_until_written(); }

}  // namespace selenograph::dem
