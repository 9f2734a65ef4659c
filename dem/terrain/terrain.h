// The terrain as everything above sees it: blocks of posts at any level of detail, and heights at places.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "dem/catalogue/catalogue.h"
#include "dem/grid/block.h"
#include "dem/grid/lattice.h"
#include "dem/support/stop_token.h"

namespace selenograph::dem {

class Detail;

struct TerrainOptions {
  std::string cache_dir;  // where pyramids are kept; empty: nothing is written, everything is rebuilt when it is needed
  std::size_t cache_bytes = std::size_t{1} << 30;  // memory for blocks and pyramids
  // A corrupt, truncated or missing file: an error that names it (false), or the next coarser layer and a warning
  // (true).
  bool fall_through = false;
  // Told, each once, what the operator should know and no client needs: a pyramid file that was deleted or made again
  // and why, a cache folder that can't be written, an unusable file that a coarser layer replaced. From any thread; may
  // be empty.
  std::function<void(const std::string&)> log{};
  int threads = 0;  // that build pyramids; 0: all cores
};

// What selection needs to know of a block before loading its posts.
struct NodeInfo {
  double error_m = 0;  // largest vertical distance from this level's surface to the finest one, within the block
  float min_m = 0, max_m = 0;  // heights; of the finest surface and this level's
  bool empty = true;           // not one valid post
  // Unusable files that it lacks, replaced by the next coarser layer or by nothing (fall_through).
  std::vector<SourceIndex> replaced;
  double detail_error_m = 0;  // of error_m, what a detail adds: a bound of what this level leaves out of it, and more
};

// Where layers meet, the detail of each shows by a share.
struct DetailOfPosts {
  int level;  // of the posts
  double share;
};

struct HeightAnswer {
  double lat_deg = 0, lon_deg = 0;
  double height_m = 0;        // NaN: no data here
  double post_spacing_m = 0;  // of the source
  int source = -1;            // index into catalogue().rasters(); -1: none
  bool filled = false;        // interpolated across no-data
  bool blended = false;       // a mean of `source` and the layers beneath it
};

struct CacheStatistics {
  std::size_t bytes = 0, capacity_bytes = 0;
  std::uint64_t hits = 0, misses = 0, evictions = 0, chunks_built = 0, chunks_read = 0, chunks_rejected = 0;
};

// What everything above sees: the pyramid's terrain (pyramid_terrain.h), or that with detail on it
// (detailed_terrain.h). const means safe to call concurrently.
//
// What isn't in memory or in the cache folder is built, in the background, while those who need it wait, each until its
// own `stop`: then they throw Cancelled. What was begun is finished and kept all the same (build_queue.h). They throw
// DataError when a file is unusable, SystemFault when the system can't read it now.
class Terrain {
 public:
  virtual ~Terrain() = default;

  virtual const Catalogue& catalogue() const = 0;
  // The same without detail.
  virtual const Terrain& plain() const = 0;
  virtual const Detail* detail() const { return nullptr; }
  // Whether a block has detail on it: it is finer than the posts that its ground is made of.
  virtual bool has_detail(const BlockId&) const { return false; }
  // With detail: what a place has of it, by the posts that it belongs to, from coarse to fine.
  virtual std::vector<DetailOfPosts> detail_at(double, double) const { return {}; }  // lat_deg, lon_deg
  // Of those that share everything each has its own; 0: without detail.
  virtual int detail_number() const { return 0; }

  // The blocks of level 0 that have data: where a walk down the quadtree starts.
  virtual const std::vector<BlockId>& roots() const = 0;
  // False where no source comes near: nothing to load.
  virtual bool has_data(const BlockId& id) const = 0;
  // The level whose vertices are the posts (or, for coarse layers, fine enough that chords stay within millimetres of
  // the sphere): the finest level worth asking for in this block's area.
  int finest_level(const BlockId& id) const;
  // The level of the posts themselves, or of the finest detail: finer blocks only follow the sphere more closely.
  virtual int posts_level(const BlockId& id) const = 0;
  // Whether node() can answer from the sources beneath the block's own surroundings. Where it can't (a coarse block
  // over very fine posts), node() first has everything beneath built: ask only when the block is really wanted.
  virtual bool node_is_cheap(const BlockId& id) const = 0;
  virtual NodeInfo node(const BlockId& id, const StopToken& stop = {}) const = 0;
  // Where node() would have something built first: wider bounds of the heights of the block and all that is beneath, by
  // a look at the files alone. Nothing where node() needs no building, or where a look doesn't tell.
  virtual std::optional<HeightRange> heights_without_building(const BlockId& id, const StopToken& stop = {}) const = 0;
  // Whether block() has posts to read from a network: not to be called within a loop then, or the loop's threads wait
  // for the network, and with them all who share their arena (on_own_threads).
  virtual bool waits_for_network(const BlockId& id) const = 0;
  // Null when the block has not one valid post.
  virtual std::shared_ptr<const Block> block(const BlockId& id, const StopToken& stop = {}) const = 0;

  // On the finest surface, by the triangles that frames are made of.
  HeightAnswer height(double lat_deg, double lon_deg, const StopToken& stop = {}) const;

  // Whether any NodeInfo::replaced may hold something.
  virtual bool has_replacements() const = 0;
  // What a client is told about what it was given: the names of these files, and of those whose place is unknown. A
  // function of the files alone, not of this machine.
  std::vector<std::string> warnings_about(std::span<const SourceIndex> replaced) const;
};

}  // namespace selenograph::dem
