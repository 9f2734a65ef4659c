// Posts from which ground with detail is made, and their interpolation across the borders of blocks.
//
// Between posts the surface is bicubic (Catmull-Rom; linear next to no-data). It is a function of position and level
// only: blocks agree on their borders to the bit.
//
// Relief follows the roughness of the posts (ReliefLaw::min_factor): their second differences over the ones of the law.
// Posts denser than what they resolve are smooth, and so is the relief on them: photographs of Hadley say so (laws.md).
//
//     p----p----P----p----p      second difference h(-2) - 2 h(0) + h(+2) of posts, at posts P that are cells apart
//     |         |         |      factor = RMS over the cells up to 4 away and both axes, nearer ones weigh more, over
//                                the law's second difference; min_factor to 1
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/detail/ground_cache.h"
#include "dem/detail/layered_posts.h"
#include "dem/detail/mean_correction.h"
#include "dem/grid/block.h"

namespace selenograph::dem {

// Blocks of posts, cached. Thread-safe. Call it inside GroundCache::run_in_arena() only.
class GroundPosts {
 public:
  // A layer's own posts; posts of the pyramid's blocks, filtered; corrections of the posts' means (mean_correction.h);
  // factors of the relief's amplitudes. The last two are at the posts of the level that is resolved, by sub-blocks.
  enum class Kind { of_layer, filtered, mean_correction, relief_factor };

  // All references must outlive this object.
  GroundPosts(const PyramidTerrain& plain, const Detail& detail, const LayeredPosts& layers, const GroundCache& cache)
      : plain_(plain), detail_(detail), layers_(layers), cache_(cache) {}

  // Returns the posts of a block, of the first two kinds; null if there are none.
  std::shared_ptr<const Block> block(Kind kind, const BlockId& id, const StopToken& stop) const;
  // Returns a sub-block of the last two kinds.
  std::shared_ptr<const Block> sub_block(Kind kind, const SubBlock& sub_block, const StopToken& stop) const;
  // Returns factors of the relief's amplitudes over posts of which `detail_level` is resolved (Detail::add), at
  // latitudes and longitudes in ticks, row by row. Empty if the relief does not follow the posts.
  std::vector<double> relief_factors(int detail_level, std::span<const std::int64_t> lats,
                                     std::span<const std::int64_t> lons, const StopToken& stop) const;

  // Returns the range of a layer's heights at all posts from which a block is interpolated, however fine the block is;
  // empty if one of them is missing.
  std::optional<HeightRange> range_around(const BlockId& id, int layer_level, const StopToken& stop) const;

 private:
  // Composes heights and sources of a layer and of all coarser layers at a block's vertices. Null if there are none.
  std::shared_ptr<const Block> compose_layers(const BlockId& id, const StopToken& stop) const;
  // Makes the factors of the relief's amplitudes at the posts of a sub-block.
  std::shared_ptr<const Block> make_relief_factors(const SubBlock& sub_block, const StopToken& stop) const;

  const PyramidTerrain& plain_;
  const Detail& detail_;
  const LayeredPosts& layers_;
  const GroundCache& cache_;
};

// Interpolates posts of one level at positions in ticks, across block borders, the poles and the date line. Holds the
// blocks that it has read. For one thread.
class PostReader {
 public:
  PostReader(const GroundPosts& ground, int level, GroundPosts::Kind kind, const StopToken& stop)
      : ground_(ground), level_(level), kind_(kind), stop_(stop) {}

  // Returns the height on a row of posts, interpolated along it: cubic between four posts, linear beside a void. `lat`
  // is a multiple of the posts' spacing and may lie beyond a pole.
  double height_on_row(std::int64_t lat, std::int64_t lon);
  // Interpolates the heights of a circle of latitude at the given longitudes: bicubic, linear beside a void. All calls
  // of one reader must pass the same longitudes, because rows of posts are cached.
  void interpolate_row(std::int64_t lat, std::span<const std::int64_t> lons, double* out);
  // Appends the sources of the posts nearest to a circle of latitude at the given longitudes.
  void append_sources(std::int64_t lat, std::span<const std::int64_t> lons, std::vector<SourceMark>& out);

 private:
  struct PostRef {
    const Block* block = nullptr;
    int r = 0, c = 0;
  };

  Tick lat_step() const { return Tick{1} << (kTickLevel - level_); }
  Tick lon_step(Tick lat);
  SourceMark source(Tick row_lat, std::int64_t lon);
  const std::vector<double>& heights_on_row(std::int64_t lat, std::span<const std::int64_t> lons);
  double post_m(Tick lat, std::int64_t lon);
  PostRef find_post(Tick lat, std::int64_t lon);
  PostRef post_in_block(const BlockId& id, Tick lat, Tick lon);
  const Block* sub_block_at(const BlockId& id, Tick lat, Tick lon);
  template <typename Load>
  const Block* find_block(const BlockId& key, const Load& load);

  const GroundPosts& ground_;
  int level_;
  GroundPosts::Kind kind_;
  const StopToken& stop_;
  std::unordered_map<BlockId, std::shared_ptr<const Block>, BlockIdHash> blocks_;
  // The latest result of each lookup: neighbouring positions repeat them.
  BlockId latest_id_;
  const Block* latest_ = nullptr;
  std::unordered_map<std::int64_t, std::vector<double>> rows_;  // heights_on_row, by latitude in ticks
  Tick cached_step_lat_ = -1, lon_step_ = 0;
  Tick cached_quad_lat_ = -1;
  std::int64_t cached_quad_lon_ = -1;
  std::array<double, 4> cached_posts_m_{};
  std::int64_t last_source_lat_ = -1;
  Tick marked_lat_ = -1;
  std::int64_t marked_lon_ = -1;
  SourceMark mark_ = kNoSource;
};

}  // namespace selenograph::dem
