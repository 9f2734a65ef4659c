// The interface of terrain: blocks of posts at any level of detail, their nodes, and heights at positions.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/catalogue/catalogue.h"
#include "dem/grid/block.h"
#include "dem/grid/lattice.h"

namespace selenograph::dem {

class DetailedTerrain;
class PyramidTerrain;

struct TerrainOptions {
  std::string cache_dir;                           // empty: nothing is written, pyramids are rebuilt when needed
  std::size_t cache_bytes = std::size_t{1} << 30;  // memory for blocks and pyramids
  // Treatment of a corrupt, truncated or missing file: an error that names it (false), or the next coarser layer and a
  // warning (true).
  bool fall_through = false;
  // Receives messages for the operator, each once, that no client needs: a pyramid file that was deleted or rebuilt and
  // why, a cache folder that cannot be written, an unusable file that a coarser layer replaced. Called from any thread;
  // may be empty.
  std::function<void(const std::string&)> log{};
  int threads = 0;                    // threads that build pyramids; 0: all cores
  std::size_t ground_disk_bytes = 0;  // disk space for blocks with detail in the cache folder; 0: none are stored
};

// Properties of a block that selection needs before its posts are loaded.
struct NodeInfo {
  double error_m = 0;  // largest vertical distance from this level's surface to the finest one, within the block
  float min_m = 0, max_m = 0;  // heights of the finest surface and of this level
  bool empty = true;           // no valid post
  // Unusable files replaced by the next coarser layer or by nothing (fall_through).
  std::vector<SourceIndex> replaced;
  double detail_error_m = 0;  // part of error_m from detail: an upper bound
  // Largest diameter or wavelength of detail that it leaves out, m; 0: none.
  double left_out_size_m = 0;
};

struct HeightAnswer {
  double lat_deg = 0, lon_deg = 0;
  double height_m = 0;        // NaN: no data
  double post_spacing_m = 0;  // of the source
  int source = -1;            // index into catalogue().rasters(); -1: none
  bool filled = false;        // interpolated across no-data
  bool blended = false;       // `source` is bent here to meet a finer layer
};

struct CacheStatistics {
  std::size_t bytes = 0, capacity_bytes = 0;
  std::uint64_t hits = 0, misses = 0, evictions = 0, chunks_built = 0, chunks_read = 0, chunks_rejected = 0;
};

// The Moon's surface: blocks, nodes (their bounds and errors) and heights. Implemented by the pyramid's terrain
// (pyramid_terrain.h) and by terrain with detail (detailed_terrain.h). What is known of a block before it is loaded:
// unloaded_blocks.h.
//
// Thread-safe: const functions may be called concurrently. Data that are neither in memory nor in the cache folder are
// built in the background. Callers wait for them until their own `stop`, then throw Cancelled; the build continues
// (build_queue.h). Members throw DataError when a file is unusable, SystemFault when the system cannot read it now.
class Terrain {
 public:
  virtual ~Terrain() = default;

  virtual const Catalogue& catalogue() const = 0;
  // The same terrain without detail.
  virtual const PyramidTerrain& plain() const = 0;
  // This terrain, if it has detail; else null.
  virtual const DetailedTerrain* detailed() const { return nullptr; }
  // Number of a terrain with detail, unique among those that share a pyramid: caches tell them apart by it. 0: without
  // detail.
  virtual int detail_number() const { return 0; }

  // Blocks of level 0 that have data: the roots of the quadtree.
  virtual const std::vector<BlockId>& roots() const = 0;
  // False if no source is near: nothing to load.
  virtual bool has_data(const BlockId& id) const = 0;
  // Level of the posts, or of the finest detail; finer blocks only follow the sphere more closely.
  virtual int posts_level(const BlockId& id) const = 0;
  // Returns the finest useful level in this block's area: its vertices are the posts or, for coarse layers, its chords
  // stay within millimetres of the sphere.
  int finest_level(const BlockId& id) const { return std::max(kSmoothLevel, posts_level(id)); }

  virtual NodeInfo node(const BlockId& id, const StopToken& stop = {}) const = 0;
  // Returns a block; null if it has no valid post.
  virtual std::shared_ptr<const Block> block(const BlockId& id, const StopToken& stop = {}) const = 0;
  // Returns the height on the finest surface, on the triangles that frames show (finest_surface.h).
  HeightAnswer height(double lat_deg, double lon_deg, const StopToken& stop = {}) const;
};

}  // namespace selenograph::dem
