#include "dem/terrain/terrain.h"

#include <fmt/format.h>
#include <xxhash.h>

#include <GeographicLib/Math.hpp>
#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <filesystem>
#include <map>
#include <mutex>
#include <string_view>
#include <unordered_set>
#include <utility>

#include "dem/detail/detailed_terrain.h"
#include "dem/files/files.h"
#include "dem/grid/surface.h"
#include "dem/posts/level_borders.h"
#include "dem/posts/post_source.h"
#include "dem/pyramid/chunk.h"
#include "dem/support/cache.h"
#include "dem/support/error.h"
#include "dem/support/parallel.h"
#include "dem/terrain/build_queue.h"
#include "dem/terrain/chunk_writer.h"
#include "dem/terrain/height_survey.h"

namespace selenograph::dem {
namespace {

// Chords of this level stay within 2 mm of the sphere: coarser layers are subdivided to it where finest posts are asked
// for.
constexpr int kSmoothLevel = 8;
// Raised when the same sources give other files: those in cache folders are then built anew.
constexpr std::uint64_t kFormatVersion = 7;

void hash_in(XXH3_state_t* state, const auto& value) { XXH3_64bits_update(state, &value, sizeof value); }

// A level beyond the posts: subdivided along the same triangles in latitude, longitude and height, so that the surface
// stays what it was but follows the sphere.
std::shared_ptr<const Block> subdivided(const Block& coarse, const BlockId& id) {
  auto block = std::make_shared<Block>();
  block->id = id;
  block->extent = extent_of(id);
  block->error_m = 0;
  fill_trigonometry(*block);
  const BlockExtent &e = block->extent, &ce = coarse.extent;
  block->vertices.reserve(block->index(e.quads, e.quads) + 1);
  block->sources.reserve(block->index(e.quads, e.quads) + 1);
  float low = kHighestRelief_m, high = kLowestRelief_m;
  bool any = false;
  for (int r = 0; r <= e.quads; ++r)
    for (int c = 0; c <= e.quads; ++c) {
      const std::int32_t dy = e.lat0 + r * e.lat_step - ce.lat0, dx = e.lon0 + c * e.lon_step - ce.lon0;
      const int cr = std::min(dy / ce.lat_step, ce.quads - 1), cc = std::min(dx / ce.lon_step, ce.quads - 1);
      const double fy = static_cast<double>(dy) / ce.lat_step - cr, fx = static_cast<double>(dx) / ce.lon_step - cc;
      const auto corner = [&](int j, int i) -> const Vertex& { return coarse.vertices[coarse.index(cr + j, cc + i)]; };
      const auto height = [&](int j, int i) { return static_cast<double>(corner(j, i).height_m); };
      const auto normal = [&](int j, int i) { return corner(j, i).normal.cast<double>(); };
      double h;
      Vec3 n;
      // Corners with weight zero may be void.
      const auto mix = [](double wa, auto a, double wb, auto b, double wc, auto c3) {
        decltype(a) sum = a * 0.0;
        if (wa != 0) sum += wa * a;
        if (wb != 0) sum += wb * b;
        if (wc != 0) sum += wc * c3;
        return sum;
      };
      if (fx + fy <= 1) {
        const double w = 1 - fx - fy;
        h = (w != 0 ? w * height(0, 0) : 0) + (fx != 0 ? fx * height(0, 1) : 0) + (fy != 0 ? fy * height(1, 0) : 0);
        n = mix(w, Vec3(normal(0, 0)), fx, Vec3(normal(0, 1)), fy, Vec3(normal(1, 0)));
      } else {
        const double w = fx + fy - 1;
        h = (w != 0 ? w * height(1, 1) : 0) + (1 - fx != 0 ? (1 - fx) * height(1, 0) : 0) +
            (1 - fy != 0 ? (1 - fy) * height(0, 1) : 0);
        n = mix(w, Vec3(normal(1, 1)), 1 - fx, Vec3(normal(1, 0)), 1 - fy, Vec3(normal(0, 1)));
      }
      block->vertices.push_back({static_cast<float>(h), n.normalized().cast<float>()});
      block->sources.push_back(coarse.source(cr + (fy > 0.5), cc + (fx > 0.5)));
      if (std::isnan(h)) continue;
      any = true;
      low = std::min(low, static_cast<float>(h)), high = std::max(high, static_cast<float>(h));
    }
  if (!any) return nullptr;
  block->pack();
  block->min_m = low, block->max_m = high;
  return block;
}

}  // namespace

void fill_trigonometry(Block& block) {
  using GeographicLib::Math;
  const BlockExtent& e = block.extent;
  const auto n = static_cast<std::size_t>(e.quads) + 1;
  for (auto* table : {&block.sin_lat, &block.cos_lat, &block.sin_lon, &block.cos_lon}) table->resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    // sincosd is exact at multiples of 90 degrees, and ticks make the same place the same number in every block.
    Math::sincosd(lat_deg_of(e.lat0 + static_cast<std::int32_t>(i) * e.lat_step), block.sin_lat[i], block.cos_lat[i]);
    Math::sincosd(lon_deg_of(wrap_lon(e.lon0 + static_cast<std::int64_t>(i) * e.lon_step)), block.sin_lon[i],
                  block.cos_lon[i]);
  }
}

struct Terrain::Impl {
  using Chunks = Cache<BlockId, Chunk, BlockIdHash>;
  using Blocks = Cache<BlockId, Block, BlockIdHash>;

  Impl(Catalogue c, const TerrainOptions& o)
      : catalogue(std::move(c)),
        any_on_network(std::any_of(catalogue.rasters().begin(), catalogue.rasters().end(),
                                   [](const RasterInfo& info) { return info.on_network; })),
        options(o),
        source(catalogue, o.fall_through,
               [this](const std::string& file, const std::string& text) { warn(file, text); }),
        blocks(o.cache_bytes / 4 * 3),
        chunks(o.cache_bytes / 4),
        writer([this](const ChunkWriter::Job& job) { write(job); }),
        builds(
            o.threads, [this](BuildQueue::Work& work, const StopToken& stop) { return take_turn(work, stop); },
            [this] { scratch.clear(); }) {
    // What a file that can't even be catalogued holds, and where, is unknown: any answer may lack it.
    for (const CatalogueProblem& problem : catalogue.problems()) {
      if (problem.located || problem.unrelated) continue;
      if (!options.fall_through) throw DataError(problem.path, problem.what);
      warn(problem.path, problem.path + ": " + problem.what);
    }
    if (!options.cache_dir.empty()) open_cache_folder();
    for (int row = 0; row < rows_of(0); ++row)
      for (int col = 0; col < columns_of(0, row); ++col)
        if (!files_within(catalogue, {0, row, col}).empty()) roots.push_back({0, row, col});
  }

  void open_cache_folder() {
    const std::string folder = options.cache_dir + "/pyramid";
    remove_stale_temporaries(folder, ".sgp.tmp-");
    try {
      probe_folder(folder);
    } catch (const SystemFault& fault) {
      cache_failed("written", fault);
    }
  }

  ChunkPlan plan(const BlockId& node, std::size_t stratum) {
    {
      std::lock_guard lock(mutex);
      if (const auto found = plans.find(node); found != plans.end()) return found->second;
    }
    const ChunkPlan made = make_plan(node, stratum);
    std::lock_guard lock(mutex);
    return plans.emplace(node, made).first->second;
  }

  ChunkPlan make_plan(const BlockId& node, std::size_t stratum) const {
    ChunkPlan plan;
    plan.node = node;
    const std::vector<int> layers = files_touching(catalogue, node, 0);
    const ChunkLevels levels = source.borders().levels_of(node, stratum);
    plan.exists = levels.exists, plan.direct = levels.direct, plan.base_level = levels.base_level;
    plan.on_network = touches_network(node, halo_deg(plan));
    const std::unique_ptr<XXH3_state_t, XXH_errorcode (*)(XXH3_state_t*)> owned(XXH3_createState(), XXH3_freeState);
    XXH3_state_t* state = owned.get();
    XXH3_64bits_reset(state);
    hash_in(state, kFormatVersion);
    hash_in(state, node);
    hash_in(state, plan.base_level);
    hash_in(state, options.fall_through);
    // Context beyond the border (filter and void filling) comes from the neighbours.
    for (const int i : around(plan, margin_deg(plan))) {
      const RasterInfo& info = catalogue.rasters()[static_cast<std::size_t>(i)];
      XXH3_64bits_update(state, info.path.data(), info.path.size());
      hash_in(state, info.stamp);
    }
    if (!catalogue.joins().offsets_m.empty() || !catalogue.one_layer()) hash_joins(state, plan);
    // Between posts of tiles: earlier versions left the gaps between them open.
    constexpr std::uint64_t kGapsClosed = 1;
    const auto is_coarser = [&](int i) {
      const auto& level = catalogue.rasters()[static_cast<std::size_t>(i)].lattice_level;
      return level && *level < plan.base_level;
    };
    if (std::count_if(layers.begin(), layers.end(), is_coarser) > 1) hash_in(state, kGapsClosed);
    if (source.borders().any()) hash_borders(state, plan);
    plan.fingerprint = XXH3_64bits_digest(state);
    return plan;
  }

  // The coarser posts beside a chunk, and a mark where there may be such beside the finer chunks that it is made of.
  void hash_borders(XXH3_state_t* state, const ChunkPlan& plan) const {
    constexpr std::uint64_t kLevelsJoined = 2;  // earlier versions left a wall one post wide
    if (!plan.direct) hash_in(state, kLevelsJoined);
    const BlockExtent e = extent_of(plan.node);
    const auto margin = static_cast<std::int64_t>(margin_deg(plan) * kTicksPerDegree);
    PostWindow w;
    w.lat_step = w.lon_step = 1 << (kTickLevel - plan.base_level);
    w.lat0 = e.lat0 - margin, w.lon0 = e.lon0 - margin;
    w.rows = static_cast<int>((e.lat1() - e.lat0 + 2 * margin) / w.lat_step) + 1;
    w.cols = static_cast<int>((e.lon1() - e.lon0 + 2 * margin) / w.lon_step) + 1;
    for (const LevelBorder& b : source.borders().near(w))
      for (const std::int64_t number : {std::int64_t{b.along_parallel}, b.at, b.from, b.to, std::int64_t{b.level}})
        hash_in(state, number);
  }

  // What a chunk in which layers meet, or have an offset, depends on besides: their bands, and what lies in them. A
  // chunk in which none do depends on nothing of it.
  void hash_joins(XXH3_state_t* state, const ChunkPlan& plan) const {
    const double margin = margin_deg(plan);
    double band_deg = 0;
    for (const int i : around(plan, margin)) {
      const RasterInfo& info = catalogue.rasters()[static_cast<std::size_t>(i)];
      const double offset_m = catalogue.offset_m(i), band_posts = source.edges().band_posts(i);
      if (offset_m == 0 && band_posts == 0) continue;
      XXH3_64bits_update(state, info.path.data(), info.path.size());
      hash_in(state, offset_m), hash_in(state, band_posts);
      band_deg = std::max(band_deg, band_posts / info.posts_per_degree);
    }
    if (band_deg == 0) return;
    for (const int i : around(plan, margin + kWidest * band_deg)) {
      const RasterInfo& info = catalogue.rasters()[static_cast<std::size_t>(i)];
      XXH3_64bits_update(state, info.path.data(), info.path.size());
      hash_in(state, info.stamp);
      if (const double offset_m = catalogue.offset_m(i); offset_m != 0) hash_in(state, offset_m);
    }
  }

  // How far beyond its border a chunk's content depends on sources, at most, where its posts are up to 8 times as far
  // apart in longitude as in latitude. Finer chunks look beyond their own borders, too.
  static constexpr int kWidestShift = 3, kWidest = 1 << kWidestShift;
  static double margin_deg(const ChunkPlan& plan) { return kWidest * halo_deg(plan) + (plan.direct ? 0 : 2); }
  static double halo_deg(const ChunkPlan& plan) {
    const double halo = 3 * std::ldexp(1.0, plan.base_level - plan.node.level) + kFillReach;
    return halo / std::ldexp(1.0, plan.base_level);
  }

  // Those no farther from a chunk than a margin, which is of more longitude next to a pole.
  std::vector<int> around(const ChunkPlan& plan, double margin) const {
    const BlockExtent e = extent_of(plan.node);
    const double poleward_deg = std::max(-lat_deg_of(e.lat0), lat_deg_of(e.lat1())) + margin;
    const BlockId nearest =
        block_at(plan.base_level, static_cast<std::int32_t>((90 + std::min(90.0, poleward_deg)) * kTicksPerDegree), 0);
    const int more = std::max(0, lon_shift(plan.base_level, nearest.row) - kWidestShift);
    const double beside_deg = std::ldexp(margin, more) - margin;
    return catalogue.touching(lat_deg_of(e.lat0), lat_deg_of(e.lat1()), lon_deg_of(e.lon0) - beside_deg,
                              lon_deg_of(e.lon1()) + beside_deg, margin);
  }

  // Whether a file that lies within a block and so far around it, in degrees of latitude, is on a network.
  bool touches_network(const BlockId& id, double around_deg) const {
    if (!any_on_network) return false;
    const BlockExtent e = extent_of(id);
    const std::vector<int> files = files_touching(catalogue, id, around_deg * e.lon_step / e.lat_step);
    return std::any_of(files.begin(), files.end(),
                       [&](int i) { return catalogue.rasters()[static_cast<std::size_t>(i)].on_network; });
  }

  // Whether loading a block that isn't here reads posts on a network.
  bool waits_for_network(const BlockId& id) {
    if (!any_on_network || blocks.holds(id)) return false;
    const ChunkPlan found = plan_for(id);
    return found.direct && id.level >= found.base_level &&
           touches_network(id, kFillReach / std::ldexp(1.0, found.base_level));
  }

  // The chunk that holds a block; where the block is finer than the posts, the one that holds its finest ancestor.
  ChunkPlan plan_for(const BlockId& id) {
    for (std::size_t stratum = 0;; ++stratum) {
      const BlockId node =
          id.level <= kRootLevel ? BlockId{kRootLevel, id.row, id.col} : ancestor_of(id, kStrata[stratum]);
      const ChunkPlan found = plan(node, stratum);
      if (found.direct || id.level <= found.finest_level()) return found;
    }
  }

  int finest_posts(const BlockId& node, std::size_t stratum, const BlockId& id) {
    const ChunkPlan here = plan(node, stratum);
    if (!here.exists) return 0;
    if (here.direct) return here.base_level;
    if (id.level >= kStrata[stratum + 1]) return finest_posts(ancestor_of(id, kStrata[stratum + 1]), stratum + 1, id);
    int needed = 0;
    for (const int i : files_touching(catalogue, id, 0))
      needed = std::max(needed, PostSource::level_needed(catalogue.rasters()[static_cast<std::size_t>(i)]));
    return std::max(needed, here.base_level);
  }

  std::shared_ptr<const Chunk> chunk(const ChunkPlan& plan, const StopToken& stop) {
    const Waiting waiting(stop.waits(), &Waits::pyramid);
    return chunks.get(
        plan.node,
        [&] {
          std::shared_ptr<const Chunk> made = kept(plan);
          if (!made) made = builds.get(plan, stop);
          const std::size_t bytes = made->bytes();
          return Chunks::Loaded{std::move(made), bytes};
        },
        stop);
  }

  std::optional<HeightRange> surveyed(const BlockId& id, const StopToken& stop) {
    const ChunkPlan found = plan_for(id);
    if (!found.exists || !found.direct || chunks.peek(found.node)) return std::nullopt;
    std::error_code error;
    if (!options.cache_dir.empty() && std::filesystem::exists(path_of(found), error)) return std::nullopt;
    {
      const std::lock_guard lock(mutex);
      if (const auto known = surveys.find(id); known != surveys.end()) return known->second;
    }
    const Waiting waiting(stop.waits(), &Waits::pyramid);
    const std::optional<HeightRange> range = survey_heights(catalogue, source, id, stop);
    const std::lock_guard lock(mutex);
    if (surveys.size() >= kMostSurveys) surveys.clear();
    surveys[id] = range;
    return range;
  }

  std::string path_of(const ChunkPlan& plan) const {
    return fmt::format("{}/pyramid/{:02}/{:06}-{:06}.sgp", options.cache_dir, plan.node.level, plan.node.row,
                       plan.node.col);
  }

  // From the cache folder; null: it has to be built.
  std::shared_ptr<const Chunk> kept(const ChunkPlan& plan) {
    if (options.cache_dir.empty() || is_distrusted(plan.node)) return nullptr;
    if (auto on_its_way = writer.find(plan.node)) return on_its_way;
    try {
      auto opened = Chunk::open(path_of(plan), plan, catalogue);
      if (opened) ++chunks_read;
      return opened;
    } catch (const DataError& error) {
      ++chunks_rejected;
      log(fmt::format("{}; it is made again", error.what()));
    } catch (const SystemFault& fault) {
      if (!is_forbidden(fault)) throw;
      distrust(plan.node);  // neither read nor written: the file stays as it is
      cache_failed("read", fault);
    }
    return nullptr;
  }

  static bool is_forbidden(const SystemFault& fault) { return fault.code() == EACCES || fault.code() == EPERM; }

  // On a builder's thread, which never waits for another.
  BuildQueue::Turn take_turn(BuildQueue::Work& work, const StopToken& stop) {
    if (!work.plan.direct)
      if (const auto first = collect_finer(work, stop)) return {nullptr, first};
    return {build(work.plan, work.finer, stop), {}};
  }

  // Takes the blocks that are there. Returns the chunk of one that isn't.
  std::optional<ChunkPlan> collect_finer(BuildQueue::Work& work, const StopToken& stop) {
    std::optional<ChunkPlan> missing;
    for (const BlockId& id : Chunk::finer_blocks(work.plan)) {
      if (work.finer.blocks.contains(id)) continue;
      stop.check();
      const ChunkPlan found = plan_for(id);
      if (!found.exists) {
        work.finer.blocks[id] = nullptr;
        continue;
      }
      const bool just_made = work.made && work.asked_for->node == found.node;
      if (missing && !just_made) continue;
      std::shared_ptr<const Chunk> finer = just_made ? work.made : chunks.peek(found.node);
      if (!finer) finer = kept(found);
      if (finer) {
        try {
          work.finer.blocks[id] = block_of(*finer, found, id, stop);
          work.finer.replaced.insert(work.finer.replaced.end(), finer->replaced().begin(), finer->replaced().end());
          continue;
        } catch (const DataError& error) {
          if (just_made || !is_of(*finer, error)) throw;
          reject(found, *finer, error);
        }
      }
      missing = found;
    }
    std::sort(work.finer.replaced.begin(), work.finer.replaced.end());
    work.finer.replaced.erase(std::unique(work.finer.replaced.begin(), work.finer.replaced.end()),
                              work.finer.replaced.end());
    return missing;
  }

  std::shared_ptr<const Chunk> build(const ChunkPlan& plan, const Chunk::Finer& finer, const StopToken& stop) {
    // The memory that one build leaves to the next is that of one of the two builders.
    Chunk::Built built = Chunk::build(plan, catalogue, source, finer, stop, plan.on_network ? nullptr : &scratch);
    ++chunks_built;
    if (!built.replaced.empty()) replacements = true;
    // A replacement for an unusable file isn't kept: the next start finds the file back, or warns again.
    const bool keep = !options.cache_dir.empty() && built.replaced.empty() && !is_distrusted(plan.node);
    const auto chunk = Chunk::from_bytes(std::move(built.bytes), plan, catalogue, std::move(built.replaced));
    if (keep) {
      try {
        writer.add({plan, chunk});
      } catch (const std::exception& error) {
        log(fmt::format("{} is kept in memory only: {}", chunk->name(), error.what()));
      }
    }
    return chunk;
  }

  // On the writer's thread.
  void write(const ChunkWriter::Job& job) {
    try {
      write_whole_file(path_of(job.plan), job.chunk->content());
      cache_works();
      if (auto opened = Chunk::open(path_of(job.plan), job.plan, catalogue)) {
        const std::size_t bytes = opened->bytes();
        chunks.replace(job.plan.node, job.chunk, std::move(opened), bytes);
      }
    } catch (const SystemFault& fault) {
      cache_failed("written", fault);  // costs time, not answers
    } catch (const DataError& error) {
      log(fmt::format("{}, just written; it is kept in memory only", error.what()));
    } catch (const std::exception& error) {
      log(fmt::format("{} is kept in memory only: {}", job.chunk->name(), error.what()));
    }
  }

  std::shared_ptr<const Block> block(const BlockId& id, const StopToken& stop) {
    const ChunkPlan found = plan_for(id);
    if (!found.exists) return nullptr;
    if (const auto here = blocks.find(id)) return *here;
    // A pyramid that is to be built is waited for out here: that may take seconds, and the arena's places are few.
    const std::shared_ptr<const Chunk> ready = chunk(found, stop);
    // Loading has loops. Loops' bodies wait for blocks that others load, too, and keep their places in the arena: who
    // would begin to load and then wait for a place there could wait for those who wait for it.
    std::shared_ptr<const Block> block;
    const auto load = [&] { block = load_once(id, found, stop); };
    if (waits_for_network(id))
      on_own_threads(kNetworkReaders, load);
    else
      where_loops_run(load);
    return block;
  }

  std::shared_ptr<const Block> load_once(const BlockId& id, const ChunkPlan& plan, const StopToken& stop) {
    return blocks.get(
        id,
        [&] {
          std::shared_ptr<const Block> made =
              id.level > plan.finest_level() ? finer_than_posts(id, plan, stop) : load(id, plan, stop);
          const std::size_t bytes = made ? made->bytes() : sizeof(Block);
          return Blocks::Loaded{std::move(made), bytes};
        },
        stop);
  }

  std::shared_ptr<const Block> finer_than_posts(const BlockId& id, const ChunkPlan& plan, const StopToken& stop) {
    const auto posts = block(ancestor_of(id, plan.base_level), stop);
    return posts ? subdivided(*posts, id) : nullptr;
  }

  // The same from a chunk at hand.
  std::shared_ptr<const Block> block_of(const Chunk& chunk, const ChunkPlan& plan, const BlockId& id,
                                        const StopToken& stop) const {
    if (id.level <= plan.finest_level()) return chunk.load(id, source, stop);
    const auto posts = chunk.load(ancestor_of(id, plan.base_level), source, stop);
    return posts ? subdivided(*posts, id) : nullptr;
  }

  static bool is_of(const Chunk& chunk, const DataError& error) { return error.file() == chunk.name(); }

  std::shared_ptr<const Block> load(const BlockId& id, const ChunkPlan& plan, const StopToken& stop) {
    // What is damaged may have been replaced meanwhile, by us or another process; then it is made again; then it is
    // right.
    constexpr int kAttempts = 3;
    for (int attempt = 1;; ++attempt) {
      const std::shared_ptr<const Chunk> opened = chunk(plan, stop);
      try {
        return opened->load(id, source, stop);
      } catch (const DataError& error) {
        if (attempt == kAttempts || !is_of(*opened, error)) throw;
        reject(plan, *opened, error);
      }
    }
  }

  // A damaged record: the file is not to be trusted any more. What can be built again is. Where only the sources are
  // others than they were, the file stays: it is right again when they are back.
  void reject(const ChunkPlan& plan, const Chunk& opened, const DataError& why) {
    ++chunks_rejected;
    if (dynamic_cast<const Chunk::OtherSources*>(&why)) {
      distrust(plan.node);
      log(fmt::format("{}; it is made again in memory", why.what()));
    } else if (!options.cache_dir.empty() && opened.current()) {
      std::error_code error;
      const bool removed = std::filesystem::remove(path_of(plan), error);
      if (removed) log(fmt::format("{}; the file was deleted", why.what()));
      // Where it can't be (a read-only disk) it must not be opened again.
      if (error) {
        distrust(plan.node);
        log(fmt::format("{}; the file can't be deleted: {}", why.what(), error.message()));
      }
    }
    chunks.erase(plan.node);
  }

  void distrust(const BlockId& node) {
    std::lock_guard lock(mutex);
    distrusted.insert(node);
  }

  bool is_distrusted(const BlockId& node) const {
    std::lock_guard lock(mutex);
    return distrusted.contains(node);
  }

  void log(const std::string& text) const {
    if (options.log) options.log(text);
  }

  void warn(const std::string& file, const std::string& text) {
    {
      std::lock_guard lock(mutex);
      if (!warnings.emplace(file, text).second) return;
    }
    log(text);
  }

  // `done`: "read" or "written".
  void cache_failed(const char* done, const SystemFault& fault) {
    const std::string trouble = fmt::format("pyramids are kept in memory only: {} can't be {}: {}", options.cache_dir,
                                            done, std::generic_category().message(fault.code()));
    {
      std::lock_guard lock(mutex);
      if (std::exchange(cache_trouble, trouble) == trouble) return;
    }
    log(trouble);
  }

  void cache_works() {
    {
      std::lock_guard lock(mutex);
      if (std::exchange(cache_trouble, {}).empty()) return;
    }
    log(fmt::format("pyramids are written to {} again", options.cache_dir));
  }

  Catalogue catalogue;
  bool any_on_network = false;
  TerrainOptions options;
  PostSource source;
  Blocks blocks;
  Chunks chunks;
  std::atomic<std::uint64_t> chunks_built{0}, chunks_read{0}, chunks_rejected{0};
  std::atomic<bool> replacements{false};
  std::atomic<int> details{0};  // terrains with detail that there were
  mutable std::mutex mutex;
  std::unordered_map<BlockId, ChunkPlan, BlockIdHash> plans;
  // Nodes whose file is damaged and can't be removed, or may not be read.
  std::unordered_set<BlockId, BlockIdHash> distrusted;
  static constexpr std::size_t kMostSurveys = 4096;
  std::unordered_map<BlockId, std::optional<HeightRange>, BlockIdHash> surveys;
  std::map<std::string, std::string> warnings;  // by file
  std::string cache_trouble;
  std::vector<BlockId> roots;
  Chunk::Scratch scratch;  // of the thread that builds what is on this machine
  ChunkWriter writer;
  BuildQueue builds;  // the last: its thread uses all of the above
};

Terrain::Terrain(Catalogue catalogue, const TerrainOptions& options)
    : impl_(std::make_shared<Impl>(std::move(catalogue), options)) {}
Terrain::Terrain(const std::shared_ptr<const Terrain>& plain, std::shared_ptr<const Detail> detail)
    : impl_(plain->impl_),
      plain_(plain),
      detailed_(std::make_unique<DetailedTerrain>(*plain, std::move(detail), impl_->blocks, ++impl_->details)) {}
Terrain::~Terrain() = default;

const Detail* Terrain::detail() const { return detailed_ ? &detailed_->detail() : nullptr; }
bool Terrain::has_detail(const BlockId& id) const { return detailed_ && detailed_->is_made(id); }
std::vector<DetailOfPosts> Terrain::detail_at(double lat_deg, double lon_deg) const {
  return detailed_->at(lat_deg, lon_deg);
}
int Terrain::detail_number() const { return detailed_ ? detailed_->number() : 0; }

const Catalogue& Terrain::catalogue() const { return impl_->catalogue; }
const PostSource& Terrain::post_source() const { return impl_->source; }

const std::vector<BlockId>& Terrain::roots() const { return impl_->roots; }

bool Terrain::has_data(const BlockId& id) const {
  if (detailed_) return detailed_->has_data(id);
  const BlockId root = id.level <= kRootLevel ? BlockId{kRootLevel, id.row, id.col} : ancestor_of(id, kRootLevel);
  // At the root level and above it a block is its root's area: the plan knows.
  return impl_->plan(root, 0).exists && (id.level <= kRootLevel || !files_within(impl_->catalogue, id).empty());
}

int Terrain::finest_level(const BlockId& id) const { return std::max(kSmoothLevel, posts_level(id)); }

int Terrain::posts_level(const BlockId& id) const {
  if (detailed_) return detailed_->finest_level(id);
  const BlockId root = id.level <= kRootLevel ? BlockId{kRootLevel, id.row, id.col} : ancestor_of(id, kRootLevel);
  return impl_->finest_posts(root, 0, id);
}

bool Terrain::node_is_cheap(const BlockId& id) const {
  return impl_->plan_for(id).direct || (detailed_ && detailed_->is_made(id));
}

NodeInfo Terrain::node(const BlockId& id, const StopToken& stop) const {
  if (detailed_) return detailed_->node(id, stop);
  const ChunkPlan plan = impl_->plan_for(id);
  if (!plan.exists) return {};
  const bool beyond = id.level > plan.finest_level();
  const auto chunk = impl_->chunk(plan, stop);
  const Chunk::Record* record = chunk->find(beyond ? ancestor_of(id, plan.finest_level()) : id);
  if (!record) throw DataError("pyramid " + to_string(plan.node), "block " + to_string(id) + " is missing");
  return {beyond ? 0.0 : record->error_m, record->min_m, record->max_m, (record->flags & Chunk::kEmpty) != 0,
          chunk->replaced()};
}

std::optional<HeightRange> Terrain::heights_without_building(const BlockId& id, const StopToken& stop) const {
  std::optional<HeightRange> range = impl_->surveyed(id, stop);
  if (range && detailed_) detailed_->widen(id, *range);
  return range;
}

bool Terrain::waits_for_network(const BlockId& id) const { return impl_->waits_for_network(id); }

std::shared_ptr<const Block> Terrain::block(const BlockId& id, const StopToken& stop) const {
  return detailed_ ? detailed_->block(id, stop) : impl_->block(id, stop);
}

void Terrain::stop_building() const { impl_->builds.stop(); }

// A block at its finest beside others at theirs, as a mesh joins them (engine/scene/mesh.h): of the vertices on an edge
// with a coarser one those are left which that one has, too, the others give way to the ones before them; and their
// heights are those of the neighbour, where its posts are coarser.
struct Terrain::FinestEdges {
  struct Edge {
    int stride = 1;
    std::shared_ptr<const Block> coarser;  // null: own heights
  };
  const Block& block;
  Edge south{}, north{}, west{}, east{};

  Vec3 vertex(int r, int c) const {
    const int quads = block.extent.quads;
    const Edge none;
    const Edge& across = r == 0 ? south : r == quads ? north : none;
    const Edge& beside = c == 0 ? west : c == quads ? east : none;
    const int at_r = r - r % beside.stride, at_c = c - c % across.stride;
    float height_m = block.vertices[block.index(at_r, at_c)].height_m;
    for (const Edge* edge : {&across, &beside})
      if (edge->coarser) {
        const std::int64_t lat = block.extent.lat0 + std::int64_t{at_r} * block.extent.lat_step,
                           lon = block.extent.lon0 + std::int64_t{at_c} * block.extent.lon_step;
        height_m = post_at(*edge->coarser, lat, lon).value_or(height_m);
      }
    return block.position(at_r, at_c, static_cast<double>(height_m));
  }

  // Of the quads whose triangles may have a place in one of them: those that share what is left of an edge.
  std::pair<int, int> rows(int r, int c) const {
    return group(r, c == 0 ? west.stride : c == block.extent.quads - 1 ? east.stride : 1);
  }
  std::pair<int, int> columns(int r, int c) const {
    return group(c, r == 0 ? south.stride : r == block.extent.quads - 1 ? north.stride : 1);
  }

 private:
  static std::pair<int, int> group(int i, int stride) { return {i - i % stride, i - i % stride + stride}; }
};

// Of the edges that a quad is at.
Terrain::FinestEdges Terrain::edges_beside(const Block& block, int r, int c, const StopToken& stop) const {
  const BlockExtent& e = block.extent;
  FinestEdges edges{block};
  if (r > 0 && r < e.quads - 1 && c > 0 && c < e.quads - 1) return edges;
  const int posts = plain().posts_level(block.id);
  const auto edge = [&](std::int64_t lat, std::int64_t lon, bool along_lon) -> FinestEdges::Edge {
    if (lat < 0 || lat >= kLatTicks) return {};
    const auto at = [&](int level) { return block_at(level, static_cast<std::int32_t>(lat), wrap_lon(lon)); };
    const BlockId probe = at(kMaxLevel);
    if (plain().posts_level(probe) >= posts) return {};
    std::shared_ptr<const Block> other = this->block(at(std::min(finest_level(probe), block.id.level)), stop);
    if (!other) return {};
    const int stride = along_lon ? other->extent.lon_step / e.lon_step : other->extent.lat_step / e.lat_step;
    return {std::clamp(stride, 1, e.quads), std::move(other)};
  };
  if (r == 0) edges.south = edge(std::int64_t{e.lat0} - 1, e.lon0, true);
  if (r == e.quads - 1) edges.north = edge(e.lat1(), e.lon0, true);
  if (c == 0) edges.west = edge(e.lat0, std::int64_t{e.lon0} - 1, false);
  if (c == e.quads - 1) edges.east = edge(e.lat0, e.lon1(), false);
  return edges;
}

HeightAnswer Terrain::height(double lat_deg, double lon_deg, const StopToken& stop) const {
  stop.check();
  HeightAnswer answer{lat_deg, wrap_lon_deg(lon_deg), std::nan(""), 0, -1, false};
  const Vec3 direction = to_cartesian({lat_deg, lon_deg, 0}).normalized();
  const double lat = (lat_deg + 90) * kTicksPerDegree, lon = (answer.lon_deg + 180) * kTicksPerDegree;
  const BlockId probe = block_at(kMaxLevel, static_cast<std::int32_t>(std::clamp(lat, 0.0, kLatTicks - 1.0)),
                                 wrap_lon(static_cast<std::int64_t>(lon)));
  // More than a block of kSmoothLevel (0.25 degrees), the largest that is looked into below.
  constexpr double kFarFromAnyFile_deg = 0.3;
  if (!has_data(probe) && files_touching(impl_->catalogue, probe, kFarFromAnyFile_deg).empty()) return answer;
  const int level = finest_level(probe);
  const double step = std::ldexp(1.0, kTickLevel - level);
  const double y = lat / step, x = lon / step;
  const auto answered = [&](const Block& block, const FinestEdges& edges, int r, int c) {
    for (const bool upper : {false, true}) {
      const QuadVertices q = vertices_of(r, c, upper);
      const auto vertex = [&](int i) { return edges.vertex(q.r[i], q.c[i]); };
      const auto distance = radial_distance({vertex(0), vertex(1), vertex(2)}, direction, 1e-9);
      if (!distance) continue;
      answer.height_m = *distance - kMoonRadius_m;
      const SourceIndex from = source_of(block.source(q.r[0], q.c[0]));
      for (int i = 0; i < 3; ++i) {
        answer.filled |= is_filled(block.source(q.r[i], q.c[i]));
        answer.blended |= is_blended(block.source(q.r[i], q.c[i]));
      }
      answer.source = from == kNoSource ? -1 : static_cast<int>(from);
      if (answer.source >= 0)
        answer.post_spacing_m = catalogue().rasters()[static_cast<std::size_t>(answer.source)].post_spacing_m;
      return true;
    }
    return false;
  };
  // The quad that the place is in; beside an edge the neighbours too, because the mesh's edges are great circles, not
  // parallels.
  for (const int dy : {0, -1, 1})
    for (const int dx : {0, -1, 1}) {
      const double row = std::floor(y) + dy, col = std::floor(x) + dx;
      if (row < 0 || row * step >= kLatTicks) continue;
      const BlockId id =
          block_at(level, static_cast<std::int32_t>(row * step), wrap_lon(static_cast<std::int64_t>(col * step)));
      const auto block = this->block(id, stop);
      if (!block) continue;
      const BlockExtent& e = block->extent;
      const int r = static_cast<int>((static_cast<std::int64_t>(row * step) - e.lat0) / e.lat_step);
      const int c = static_cast<int>((wrap_lon(static_cast<std::int64_t>(col * step)) - e.lon0) / e.lon_step);
      const FinestEdges edges = edges_beside(*block, r, c, stop);
      const auto [first_r, past_r] = edges.rows(r, c);
      const auto [first_c, past_c] = edges.columns(r, c);
      for (int at_r = first_r; at_r < past_r; ++at_r)
        for (int at_c = first_c; at_c < past_c; ++at_c)
          if (answered(*block, edges, at_r, at_c)) return answer;
    }
  return answer;
}

std::vector<std::string> Terrain::warnings() const {
  std::lock_guard lock(impl_->mutex);
  std::vector<std::string> texts;
  for (const auto& [file, text] : impl_->warnings) texts.push_back(text);
  return texts;
}

bool Terrain::has_replacements() const { return impl_->replacements; }

std::vector<std::string> Terrain::warnings_about(std::span<const SourceIndex> replaced) const {
  const auto name = [](const std::string& path) { return std::filesystem::path(path).filename().string(); };
  std::vector<std::string> texts;
  for (const CatalogueProblem& problem : catalogue().problems())
    if (!problem.located && !problem.unrelated)
      texts.push_back(name(problem.path) + ": can't be used; where it lies is unknown");
  for (const SourceIndex i : replaced)
    texts.push_back(name(catalogue().rasters()[i].path) + ": can't be used; the layer below stands in for it");
  return texts;
}

std::string Terrain::cache_trouble() const {
  std::lock_guard lock(impl_->mutex);
  return impl_->cache_trouble;
}

void Terrain::keep_less(std::size_t bytes) const { impl_->blocks.reserve(bytes); }

CacheStatistics Terrain::statistics() const {
  const Impl& i = *impl_;
  return {i.blocks.bytes() + i.chunks.bytes(),
          i.blocks.capacity() + i.chunks.capacity(),
          i.blocks.hits(),
          i.blocks.misses(),
          i.blocks.evictions() + i.chunks.evictions(),
          i.chunks_built,
          i.chunks_read,
          i.chunks_rejected};
}

std::vector<BlockId> Terrain::chunks_to_ingest() const {
  std::vector<BlockId> found;
  const std::function<void(const BlockId&, std::size_t)> visit = [&](const BlockId& node, std::size_t stratum) {
    const ChunkPlan plan = impl_->plan(node, stratum);
    if (!plan.exists) return;
    if (!plan.direct) {
      std::vector<BlockId> level{node};
      while (level[0].level < plan.base_level) {
        std::vector<BlockId> next;
        for (const BlockId& id : level)
          for (const BlockId& child : children_of(id)) next.push_back(child);
        level = std::move(next);
      }
      for (const BlockId& child : level) visit(child, stratum + 1);
    }
    found.push_back(node);  // after the finer chunks that it is made of
  };
  for (const BlockId& root : impl_->roots) visit({kRootLevel, root.row, root.col}, 0);
  return found;
}

void Terrain::wait_until_written() const { impl_->writer.wait_until_done(); }

void Terrain::ensure_chunk(const BlockId& node) const {
  std::size_t stratum = 0;
  while (kStrata[stratum] != node.level) ++stratum;
  impl_->chunk(impl_->plan(node, stratum), {});
}

}  // namespace selenograph::dem
