// Heights of one sample tile.
#pragma once

#include <cstdint>
#include <vector>

#include "dem/grid/degrees.h"
#include "dem/sample/landscape.h"

namespace selenograph::dem::sample {

struct Tile {
  int south_deg, west_deg;  // west in 0..359
  int posts_per_degree;
  double top_deg() const { return south_deg + 1; }
  double step_deg() const { return 1.0 / posts_per_degree; }
};

// Crater that reaches a block, and its shape.
struct CraterInBlock {
  const Crater* crater;
  const CraterShape* shape;
};

// Computes the heights of a tile, block by block. The height of a post depends on its position and the seed only.
class TileTerrain {
 public:
  TileTerrain(const Tile& tile, std::uint64_t seed);
  // Fills one row of blocks of posts[ppd][ppd], on all threads.
  void evaluate_strip(int strip, std::vector<std::int16_t>& posts) const;
  int strips() const { return blocks_; }

 private:
  struct Window {  // rows and columns of posts, half open
    int row0, row1, column0, column1;
  };
  Window window_of(const Crater& crater, double reach_m) const;
  void bin_craters();
  Vec3 direction(int row, int column) const {
    const SineCosine &lat = rows_[static_cast<std::size_t>(row)], &lon = columns_[static_cast<std::size_t>(column)];
    return {lat.cosine * lon.cosine, lat.cosine * lon.sine, lat.sine};
  }
  void stamp(const CraterInBlock& c, const Window& block, std::vector<Layers>& layers) const;
  void evaluate_block(const Window& block, const std::vector<int>& craters, std::vector<Layers>& layers) const;

  Tile tile_;
  Landscape landscape_;
  int size_, blocks_;
  std::vector<SineCosine> rows_, columns_;
  std::vector<Crater> craters_;  // oldest first
  std::vector<CraterShape> shapes_;
  std::vector<std::vector<int>> in_block_;  // per block: indices of the craters that reach it, oldest first
};

}  // namespace selenograph::dem::sample
