#include "dem/sample/tile_terrain.h"

#include <algorithm>
#include <cmath>

#include "dem/base/parallel.h"

namespace selenograph::dem::sample {

namespace {

constexpr int kBlock = 64;  // posts along a side; one block's layers fit into a core's second-level cache

}  // namespace

TileTerrain::TileTerrain(const Tile& tile, std::uint64_t seed)
    : tile_(tile), landscape_(seed), size_(tile.posts_per_degree), blocks_((size_ + kBlock - 1) / kBlock) {
  // Compute sines from degrees: they are exact at multiples of 90 degrees, so that the first row of a polar tile is one
  // point.
  for (int i = 0; i < size_; ++i) {
    rows_.push_back(sine_cosine_of_deg(tile.top_deg() - i * tile.step_deg()));
    columns_.push_back(sine_cosine_of_deg(tile.west_deg + i * tile.step_deg()));
  }
  // Omit craters of less than three posts, which have no visible shape.
  const double smallest_m = 3 * tile.step_deg() * kRadiansPerDegree * kMoonRadius_m;
  const double west = tile.west_deg, south = tile.south_deg;
  craters_ = craters_reaching({south, south + 1, west, west + 1}, seed, smallest_m);
  shapes_.reserve(craters_.size());
  for (const Crater& c : craters_) shapes_.emplace_back(c);
  bin_craters();
}

// Returns the posts of the tile that a crater may reach.
TileTerrain::Window TileTerrain::window_of(const Crater& crater, double reach_m) const {
  const double reach_deg = reach_m / kMoonRadius_m / kRadiansPerDegree;
  const double ppd = size_;
  const auto post = [&](double x) { return static_cast<int>(std::clamp(x, -1.0, ppd + 1)); };
  Window w{post((tile_.top_deg() - crater.lat_deg - reach_deg) * ppd),
           post((tile_.top_deg() - crater.lat_deg + reach_deg) * ppd) + 2, 0, size_};
  if (std::abs(crater.lat_deg) + reach_deg < 90) {
    const double half_deg =
        std::asin(std::sin(reach_deg * kRadiansPerDegree) / std::cos(crater.lat_deg * kRadiansPerDegree)) /
        kRadiansPerDegree;
    // Count longitudes from the tile's middle, so that the wrap is far from every crater that reaches the tile, except
    // the widest.
    const double middle = wrap_lon_deg(crater.lon_deg - tile_.west_deg - 0.5) + 0.5;
    if (half_deg < 90) {
      w.column0 = post((middle - half_deg) * ppd);
      w.column1 = post((middle + half_deg) * ppd) + 2;
    }
  }
  w = {std::max(w.row0 - 1, 0), std::min(w.row1, size_), std::max(w.column0 - 1, 0), std::min(w.column1, size_)};
  return w;
}

// Lists, for each block of posts, the craters that may reach it, oldest first.
void TileTerrain::bin_craters() {
  in_block_.resize(static_cast<std::size_t>(blocks_ * blocks_));
  for (int i = 0; i < static_cast<int>(craters_.size()); ++i) {
    const auto crater = static_cast<std::size_t>(i);
    const Window w = window_of(craters_[crater], shapes_[crater].reach_m());
    for (int r = w.row0 / kBlock; r * kBlock < w.row1; ++r) {
      for (int c = w.column0 / kBlock; c * kBlock < w.column1; ++c) {
        in_block_[static_cast<std::size_t>(r * blocks_ + c)].push_back(i);
      }
    }
  }
}

// Adds a crater to the layers of a block's posts, and erases older relief of its size.
void TileTerrain::stamp(const CraterInBlock& c, const Window& block, std::vector<Layers>& layers) const {
  const Window w = window_of(*c.crater, c.shape->reach_m());
  const EastNorthUp axes = local_axes(c.crater->center);
  const auto own = static_cast<std::size_t>(layer_of_octave(c.crater->octave));
  // Erase relief of up to twice the crater's own size, too: the rim of a slightly larger crater does not survive in a
  // cavity.
  const std::size_t first_erased = std::max<std::size_t>(1, own - 1);
  for (int row = std::max(w.row0, block.row0); row < std::min(w.row1, block.row1); ++row) {
    for (int column = std::max(w.column0, block.column0); column < std::min(w.column1, block.column1); ++column) {
      const Vec3 away = (direction(row, column) - c.crater->center) * kMoonRadius_m;
      const double r2 = away.squared_norm();
      if (r2 >= c.shape->reach_m() * c.shape->reach_m()) continue;
      // Take the azimuth from the tangent plane, the distance along the chord (within 0.01 % of the great circle at 80
      // km).
      const double east = away.dot(axes.east), north = away.dot(axes.north);
      const double planar2 = east * east + north * north;
      const double stretch = planar2 > 0 ? std::sqrt(r2 / planar2) : 1;
      const CraterShape::Trace t = c.shape->trace(east * stretch, north * stretch);
      Layers& post = layers[static_cast<std::size_t>((row - block.row0) * kBlock + column - block.column0)];
      if (t.keep < 1) {
        for (std::size_t i = first_erased; i < post.m.size(); ++i) post.m[i] *= static_cast<float>(t.keep);
      }
      post.m[own] += static_cast<float>(t.height_m);
    }
  }
}

// Applies the history of each post in order: highlands, old craters, lava, young craters.
void TileTerrain::evaluate_block(const Window& block, const std::vector<int>& craters,
                                 std::vector<Layers>& layers) const {
  const auto for_each_post = [&](auto&& visit) {
    for (int row = block.row0; row < block.row1; ++row) {
      for (int column = block.column0; column < block.column1; ++column) {
        visit(direction(row, column) * kMoonRadius_m,
              layers[static_cast<std::size_t>((row - block.row0) * kBlock + column - block.column0)]);
      }
    }
  };
  layers.assign(kBlock * kBlock, {});
  for_each_post([&](const Vec3& p_m, Layers& post) { landscape_.lay_highlands(p_m, post); });
  bool flooded = false;
  const auto flood = [&] {
    for_each_post([&](const Vec3& p_m, Layers& post) { landscape_.flood_maria(p_m, post); });
    flooded = true;
  };
  for (const int i : craters) {
    const auto crater = static_cast<std::size_t>(i);
    if (!flooded && craters_[crater].age < 1) flood();  // craters of age below 1 are younger than the maria
    stamp({&craters_[crater], &shapes_[crater]}, block, layers);
  }
  if (!flooded) flood();
}

// Evaluates a row of blocks in parallel, and rounds the sums of their layers to whole metres.
void TileTerrain::evaluate_strip(int strip, std::vector<std::int16_t>& posts) const {
  in_parallel(static_cast<std::size_t>(blocks_), [&](std::size_t index) {
    const int b = static_cast<int>(index);
    thread_local std::vector<Layers> layers;
    const Window block{strip * kBlock, std::min((strip + 1) * kBlock, size_), b * kBlock,
                       std::min((b + 1) * kBlock, size_)};
    evaluate_block(block, in_block_[static_cast<std::size_t>(strip * blocks_ + b)], layers);
    for (int row = block.row0; row < block.row1; ++row) {
      for (int column = block.column0; column < block.column1; ++column) {
        const Layers& post = layers[static_cast<std::size_t>((row - block.row0) * kBlock + column - block.column0)];
        posts[static_cast<std::size_t>(row) * static_cast<std::size_t>(size_) + static_cast<std::size_t>(column)] =
            static_cast<std::int16_t>(std::lround(post.sum()));
      }
    }
  });
}

}  // namespace selenograph::dem::sample
