// Finest posts over a window of the lattice, composed from every layer that covers it.
//
// The finest valid layer wins; no-data is filled from the next coarser layer. What is still missing between valid posts
// is interpolated and flagged. A product whose posts lie on the lattice is copied; any other is interpolated by a
// Catmull-Rom bicubic kernel (bilinear beside voids), exact for a linear slope.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "dem/block.h"
#include "dem/catalogue.h"

namespace selenograph::dem {

// A window of posts: rows of latitude ticks lat0 + r * lat_step, columns of longitude ticks lon0 + c * lon_step. It may
// reach past a pole (rows continue on the opposite meridian) and around the globe.
struct PostWindow {
  std::int64_t lat0 = 0, lon0 = 0;
  std::int32_t lat_step = 1, lon_step = 1;
  int rows = 0, cols = 0;
  std::size_t size() const { return static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols); }
};

struct Posts {
  std::vector<float> heights;       // m, NaN: no data
  std::vector<SourceMark> sources;  // as in Block::sources
};

// No-data is interpolated when valid posts lie on two opposite sides within this many posts: 240 m at SLDEM2013's
// 4096 px/deg, which closes what stereo matching loses in small shadows and leaves real gaps as gaps.
inline constexpr int kFillReach = 32;

// Safe to call concurrently: keeps a pool of open files, each lent to one thread at a time.
class PostSource {
 public:
  // `warn` is told of each unusable file that a coarser layer replaced (fall_through); without fall_through an unusable
  // file throws DataError.
  PostSource(const Catalogue& catalogue, bool fall_through, std::function<void(const std::string&)> warn);
  ~PostSource();

  // The lattice level that a source needs for its posts to be (nearly) vertices.
  static int level_needed(const RasterInfo& info);

  // How often an unusable file was replaced by the next coarser layer: what is made meanwhile is not to be kept.
  std::uint64_t times_fallen_through() const { return times_fallen_through_; }

  // Layers composed, voids not yet filled.
  Posts compose(const PostWindow& window) const;
  // Fills voids, in place. Needs kFillReach posts of context around what must be right.
  static void fill_voids(const PostWindow& window, Posts& posts);

 private:
  class Pool;
  class Mapping;
  struct Patch;
  void close_gaps(int source, Patch& patch) const;
  void compose_rows(const PostWindow& window, int r0, int r1, Posts& posts) const;
  enum class Reach { between_posts, beside_posts };
  bool add_layer(int source, const PostWindow& window, std::size_t offset, Reach reach, Posts& posts) const;
  const Catalogue& catalogue_;
  bool fall_through_;
  std::function<void(const std::string&)> warn_;
  std::unique_ptr<Pool> pool_;
  mutable std::atomic<std::uint64_t> times_fallen_through_{0};
  double post_deg_ = 0;  // of the coarsest file
};

}  // namespace selenograph::dem
