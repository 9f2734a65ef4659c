#include "dem/terrain/chunk_store.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <system_error>
#include <utility>

#include "dem/base/wait_clock.h"
#include "dem/files/whole_file.h"

namespace selenograph::dem {
namespace {

bool is_forbidden(const SystemFault& fault) { return fault.code() == EACCES || fault.code() == EPERM; }

bool is_of(const Chunk& chunk, const DataError& error) { return error.file() == chunk.name(); }

bool is_just_made(const BuildQueue::Work& work, const ChunkPlan& plan) {
  return work.made && work.asked_for->node == plan.node;
}

}  // namespace

ChunkStore::ChunkStore(const Catalogue& catalogue, const PostSource& source, const ChunkPlans& plans,
                       TroubleLog& trouble, const TerrainOptions& options, std::size_t bytes)
    : catalogue_(catalogue),
      source_(source),
      plans_(plans),
      trouble_(trouble),
      cache_dir_(options.cache_dir),
      chunks_(bytes),
      writer_([this](const ChunkWriter::Job& job) { write(job); }),
      builds_(
          options.threads, [this](BuildQueue::Work& work, const StopToken& stop) { return take_turn(work, stop); },
          [this] { scratch_.clear(); }) {}

void ChunkStore::open_folder() {
  if (!cache_dir_.empty()) remove_stale_temporaries(cache_dir_ + "/pyramid", ".sgp.tmp-");
}

bool ChunkStore::has(const ChunkPlan& plan) const {
  if (chunks_.peek(plan.node)) return true;
  std::error_code error;
  return !cache_dir_.empty() && std::filesystem::is_regular_file(path_of(plan), error);
}

CacheStatistics ChunkStore::statistics() const {
  return {chunks_.bytes(), chunks_.capacity(), 0, 0, chunks_.evictions(), chunks_built_,
          chunks_read_,    chunks_rejected_};
}

std::shared_ptr<const Chunk> ChunkStore::get(const ChunkPlan& plan, const StopToken& stop) {
  const Waiting waiting(stop.waits(), &Waits::pyramid);
  return chunks_.get(
      plan.node,
      [&] {
        std::shared_ptr<const Chunk> made = kept(plan);
        if (!made) made = builds_.get(plan, stop);
        const std::size_t bytes = made->bytes();
        return decltype(chunks_)::Loaded{std::move(made), bytes};
      },
      stop);
}

std::string ChunkStore::path_of(const ChunkPlan& plan) const {
  return fmt::format("{}/pyramid/{:02}/{:06}-{:06}.sgp", cache_dir_, plan.node.level, plan.node.row, plan.node.col);
}

// From the cache folder; null: it has to be built.
std::shared_ptr<const Chunk> ChunkStore::kept(const ChunkPlan& plan) {
  if (cache_dir_.empty() || is_distrusted(plan.node)) return nullptr;
  if (auto on_its_way = writer_.find(plan.node)) return on_its_way;
  try {
    auto opened = Chunk::open(path_of(plan), plan, catalogue_);
    if (opened) ++chunks_read_;
    return opened;
  } catch (const DataError& error) {
    ++chunks_rejected_;
    trouble_.log(fmt::format("{}; it is made again", error.what()));
  } catch (const SystemFault& fault) {
    if (!is_forbidden(fault)) throw;
    distrust(plan.node);  // neither read nor written: the file stays as it is
    trouble_.cache_failed("read", fault);
  }
  return nullptr;
}

// On a builder's thread, which never waits for another.
BuildQueue::Turn ChunkStore::take_turn(BuildQueue::Work& work, const StopToken& stop) {
  if (!work.plan.direct)
    if (const auto first = collect_finer(work, stop)) return {nullptr, first};
  return {build(work.plan, work.finer, stop), {}};
}

// From a finer chunk, if it is there.
bool ChunkStore::take_finer(BuildQueue::Work& work, const ChunkPlan& from, const BlockId& id, const StopToken& stop) {
  const bool just_made = is_just_made(work, from);
  std::shared_ptr<const Chunk> finer = just_made ? work.made : chunks_.peek(from.node);
  if (!finer) finer = kept(from);
  if (!finer) return false;
  try {
    // Posts that are farther apart are taken as they are, once.
    const BlockId posts = ancestor_of(id, std::min(id.level, from.finest_level()));
    auto& blocks = work.finer.blocks;
    if (!blocks.contains(posts)) blocks.emplace(posts, finer->load(posts, source_, stop));
    if (posts != id) blocks.emplace(id, std::shared_ptr<const Block>(blocks.at(posts)));
    work.finer.replaced.insert(work.finer.replaced.end(), finer->replaced().begin(), finer->replaced().end());
    return true;
  } catch (const DataError& error) {
    if (just_made || !is_of(*finer, error)) throw;
    reject(from, *finer, error);
    return false;
  }
}

// Takes the blocks that are there. Returns the chunk of one that isn't.
std::optional<ChunkPlan> ChunkStore::collect_finer(BuildQueue::Work& work, const StopToken& stop) {
  std::optional<ChunkPlan> missing;
  for (const BlockId& id : Chunk::finer_blocks(work.plan)) {
    if (work.finer.blocks.contains(id)) continue;
    stop.check();
    const ChunkPlan found = plans_.plan_for(id);
    if (!found.exists) {
      work.finer.blocks[id] = nullptr;
      continue;
    }
    // Once one is missing only what was just made is taken: the others are looked for when they are needed.
    if (missing && !is_just_made(work, found)) continue;
    if (!take_finer(work, found, id, stop)) missing = found;
  }
  std::sort(work.finer.replaced.begin(), work.finer.replaced.end());
  work.finer.replaced.erase(std::unique(work.finer.replaced.begin(), work.finer.replaced.end()),
                            work.finer.replaced.end());
  return missing;
}

std::shared_ptr<const Chunk> ChunkStore::build(const ChunkPlan& plan, const Chunk::Finer& finer,
                                               const StopToken& stop) {
  // The memory that one build leaves to the next is that of one of the two builders.
  Chunk::Built built = Chunk::build(plan, catalogue_, source_, finer, stop, plan.on_network ? nullptr : &scratch_);
  ++chunks_built_;
  if (!built.replaced.empty()) replacements_ = true;
  // A replacement for an unusable file isn't kept: the next start finds the file back, or warns again.
  const bool whole = !cache_dir_.empty() && built.replaced.empty(), keep = whole && !is_distrusted(plan.node);
  if (whole && !keep) note_unwritten(path_of(plan) + ": can be neither used nor replaced");
  const auto chunk = Chunk::from_bytes(std::move(built.bytes), plan, catalogue_, std::move(built.replaced));
  if (keep) {
    try {
      writer_.add({plan, chunk});
    } catch (const std::exception& error) {
      trouble_.log(fmt::format("{} is kept in memory only: {}", chunk->name(), error.what()));
      note_unwritten(path_of(plan) + ": " + error.what());
    }
  }
  return chunk;
}

// On the writer's thread.
void ChunkStore::write(const ChunkWriter::Job& job) {
  try {
    write_whole_file(path_of(job.plan), job.chunk->content());
    trouble_.cache_works();
    if (auto opened = Chunk::open(path_of(job.plan), job.plan, catalogue_)) {
      const std::size_t bytes = opened->bytes();
      chunks_.replace(job.plan.node, job.chunk, std::move(opened), bytes);
    }
  } catch (const SystemFault& fault) {
    trouble_.cache_failed("written", fault);  // costs time, not answers
    note_unwritten(fault.what());
  } catch (const DataError& error) {
    trouble_.log(fmt::format("{}, just written; it is kept in memory only", error.what()));
    note_unwritten(error.what());
  } catch (const std::exception& error) {
    trouble_.log(fmt::format("{} is kept in memory only: {}", job.chunk->name(), error.what()));
    note_unwritten(path_of(job.plan) + ": " + error.what());
  }
}

void ChunkStore::note_unwritten(const std::string& why) {
  std::lock_guard lock(mutex_);
  if (unwritten_.empty()) unwritten_ = why;
}

std::string ChunkStore::unwritten() const {
  std::lock_guard lock(mutex_);
  return unwritten_;
}

std::shared_ptr<const Block> ChunkStore::load(const BlockId& id, const ChunkPlan& plan, const StopToken& stop) {
  // What is damaged may have been replaced meanwhile, by us or another process; then it is made again; then it is
  // right.
  constexpr int kAttempts = 3;
  for (int attempt = 1;; ++attempt) {
    const std::shared_ptr<const Chunk> opened = get(plan, stop);
    try {
      return opened->load(id, source_, stop);
    } catch (const DataError& error) {
      if (attempt == kAttempts || !is_of(*opened, error)) throw;
      reject(plan, *opened, error);
    }
  }
}

// A damaged record: the file is not to be trusted any more. What can be built again is. Where only the sources are
// others than they were, the file stays: it is right again when they are back.
void ChunkStore::reject(const ChunkPlan& plan, const Chunk& opened, const DataError& why) {
  ++chunks_rejected_;
  if (dynamic_cast<const Chunk::OtherSources*>(&why)) {
    distrust(plan.node);
    trouble_.log(fmt::format("{}; it is made again in memory", why.what()));
  } else if (!cache_dir_.empty() && opened.current()) {
    std::error_code error;
    const bool removed = std::filesystem::remove(path_of(plan), error);
    if (removed) trouble_.log(fmt::format("{}; the file was deleted", why.what()));
    // Where it can't be (a read-only disk) it must not be opened again.
    if (error) {
      distrust(plan.node);
      trouble_.log(fmt::format("{}; the file cannot be deleted: {}", why.what(), error.message()));
    }
  }
  chunks_.erase(plan.node);
}

void ChunkStore::distrust(const BlockId& node) {
  std::lock_guard lock(mutex_);
  distrusted_.insert(node);
}

bool ChunkStore::is_distrusted(const BlockId& node) const {
  std::lock_guard lock(mutex_);
  return distrusted_.contains(node);
}

}  // namespace selenograph::dem
