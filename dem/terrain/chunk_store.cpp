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

// Returns whether an error is about the chunk's own file, not about a file of posts.
bool concerns(const Chunk& chunk, const DataError& error) { return error.file() == chunk.name(); }

// Returns whether a plan's chunk is the one that the job was waiting for.
bool is_just_made(const BuildQueue::Work& work, const ChunkPlan& plan) {
  return work.finer_chunk && work.finer_plan->node == plan.node;
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

// Looks in memory, then in the cache folder, then builds. One of several concurrent callers does so.
std::shared_ptr<const Chunk> ChunkStore::get(const ChunkPlan& plan, const StopToken& stop) {
  const Waiting waiting(stop.waits(), &Waits::pyramid);
  return chunks_.get(
      plan.node,
      [&] {
        std::shared_ptr<const Chunk> chunk = stored_chunk(plan);
        if (!chunk) chunk = builds_.get(plan, stop);
        const std::size_t bytes = chunk->bytes();
        return decltype(chunks_)::Loaded{std::move(chunk), bytes};
      },
      stop);
}

std::string ChunkStore::path_of(const ChunkPlan& plan) const {
  return fmt::format("{}/pyramid/{:02}/{:06}-{:06}.sgp", cache_dir_, plan.node.level, plan.node.row, plan.node.col);
}

// Returns a chunk that is being written or lies in the cache folder; null if it must be built.
std::shared_ptr<const Chunk> ChunkStore::stored_chunk(const ChunkPlan& plan) {
  if (cache_dir_.empty() || is_distrusted(plan.node)) return nullptr;
  if (auto unfinished = writer_.find(plan.node)) return unfinished;
  try {
    auto opened = Chunk::open(path_of(plan), plan, catalogue_);
    if (opened) ++chunks_read_;
    return opened;
  } catch (const DataError& error) {
    ++chunks_rejected_;
    trouble_.log(fmt::format("{}; it is made again", error.what()));
  } catch (const SystemFault& fault) {
    if (!is_forbidden(fault)) throw;
    distrust(plan.node);  // never touch the file again: it may neither be read nor replaced
    trouble_.cache_failed("read", fault);
  }
  return nullptr;
}

// Takes one turn of a chunk's build, on a builder's thread. Never waits for another chunk, but returns the one that it
// needs first.
BuildQueue::Turn ChunkStore::take_turn(BuildQueue::Work& work, const StopToken& stop) {
  if (!work.plan.direct)
    if (const auto first = collect_finer(work, stop)) return {nullptr, first};
  return {build(work.plan, work.finer, stop), {}};
}

// Collects a block from a finer chunk; returns false if that chunk has to be built first.
bool ChunkStore::collect_block(BuildQueue::Work& work, const ChunkPlan& from, const BlockId& id,
                               const StopToken& stop) {
  const bool just_made = is_just_made(work, from);
  std::shared_ptr<const Chunk> finer = just_made ? work.finer_chunk : chunks_.peek(from.node);
  if (!finer) finer = stored_chunk(from);
  if (!finer) return false;
  try {
    // If the posts are coarser than the block, insert the block of posts once, under both ids.
    const BlockId posts = ancestor_of(id, std::min(id.level, from.finest_level()));
    auto& blocks = work.finer.blocks;
    if (!blocks.contains(posts)) blocks.emplace(posts, finer->load(posts, source_, stop));
    if (posts != id) blocks.emplace(id, std::shared_ptr<const Block>(blocks.at(posts)));
    work.finer.replaced.insert(work.finer.replaced.end(), finer->replaced().begin(), finer->replaced().end());
    return true;
  } catch (const DataError& error) {
    if (just_made || !concerns(*finer, error)) throw;
    reject(from, *finer, error);
    return false;
  }
}

// Collects the finer blocks whose chunks exist already. Returns the chunk of the first missing one.
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
    // After the first missing block, collect only from the chunk just built: later turns read the others.
    if (missing && !is_just_made(work, found)) continue;
    if (!collect_block(work, found, id, stop)) missing = found;
  }
  std::sort(work.finer.replaced.begin(), work.finer.replaced.end());
  work.finer.replaced.erase(std::unique(work.finer.replaced.begin(), work.finer.replaced.end()),
                            work.finer.replaced.end());
  return missing;
}

// Builds a chunk and passes it to the writer of the cache folder.
std::shared_ptr<const Chunk> ChunkStore::build(const ChunkPlan& plan, const Chunk::Finer& finer,
                                               const StopToken& stop) {
  Chunk::Built built = Chunk::build(plan, catalogue_, source_, finer, stop, &scratch_);
  ++chunks_built_;
  if (!built.replaced.empty()) replacements_ = true;
  // Do not store a chunk with replacements: the next start may find the file repaired, or else must warn again.
  const bool storable = !cache_dir_.empty() && built.replaced.empty(), store = storable && !is_distrusted(plan.node);
  if (storable && !store) note_unwritten(path_of(plan) + ": can be neither used nor replaced");
  const auto chunk = Chunk::from_bytes(std::move(built.bytes), plan, catalogue_, std::move(built.replaced));
  if (store) {
    try {
      writer_.add({plan, chunk});
    } catch (const std::exception& error) {
      trouble_.log(fmt::format("{} is kept in memory only: {}", chunk->name(), error.what()));
      note_unwritten(path_of(plan) + ": " + error.what());
    }
  }
  return chunk;
}

// Runs on the writer's thread. Replaces the chunk in memory by the file just written, whose pages the system can drop.
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

// Loads a block from its chunk; a damaged chunk is rejected and made again.
std::shared_ptr<const Block> ChunkStore::load(const BlockId& id, const ChunkPlan& plan, const StopToken& stop) {
  // The first retry may find a file that another thread or process has replaced and that is damaged, too. The second
  // retry builds the chunk, and a chunk in memory has no file to be damaged.
  constexpr int kAttempts = 3;
  for (int attempt = 1;; ++attempt) {
    const std::shared_ptr<const Chunk> opened = get(plan, stop);
    try {
      return opened->load(id, source_, stop);
    } catch (const DataError& error) {
      if (attempt == kAttempts || !concerns(*opened, error)) throw;
      reject(plan, *opened, error);
    }
  }
}

// Handles a damaged record: deletes the file, so that the chunk is built again. If only the sources differ from those
// of the file, the file stays: it is valid again when they are restored.
void ChunkStore::reject(const ChunkPlan& plan, const Chunk& opened, const DataError& why) {
  ++chunks_rejected_;
  if (dynamic_cast<const Chunk::OtherSources*>(&why)) {
    distrust(plan.node);
    trouble_.log(fmt::format("{}; it is made again in memory", why.what()));
  } else if (!cache_dir_.empty() && opened.current()) {
    std::error_code error;
    const bool removed = std::filesystem::remove(path_of(plan), error);
    if (removed) trouble_.log(fmt::format("{}; the file was deleted", why.what()));
    // If the file cannot be deleted (a read-only disk), never open it again.
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
