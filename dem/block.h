// One block of the mesh: posts of one level over one footprint, with what shading and truth need of them.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <vector>

#include "dem/geodesy.h"
#include "dem/lattice.h"

namespace selenograph::dem {

// Where a post comes from: an index into Catalogue::rasters() (64 800 tiles and more), or kNoSource, and whether it was
// filled.
using SourceMark = std::uint32_t;
inline constexpr SourceMark kNoSource = 0x7fffffff;
inline constexpr SourceMark kFilledBit = 0x80000000;

// Immutable once made, shared between frames. Arrays are (quads + 1)^2, row 0 in the south, column 0 in the west.
struct Block {
  BlockId id;
  BlockExtent extent{};
  std::vector<float> heights;            // m above the sphere; NaN: no data
  std::vector<Eigen::Vector3f> normals;  // unit, MOON_ME, for shading: see shading_normals.h
  // Index into Catalogue::rasters(), with kFilledBit where the post was interpolated across a void. One value when the
  // whole block has the same, else one per post.
  std::vector<SourceMark> sources;
  double error_m = 0;          // as in NodeInfo
  float min_m = 0, max_m = 0;  // of the heights here and of the finest surface beneath
  // Separable sines and cosines of rows and columns: the bulk conversion to Cartesian.
  std::vector<double> sin_lat, cos_lat, sin_lon, cos_lon;

  int side() const { return extent.quads + 1; }
  std::size_t index(int r, int c) const {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(side()) + static_cast<std::size_t>(c);
  }
  SourceMark source(int r, int c) const { return sources.size() == 1 ? sources[0] : sources[index(r, c)]; }
  Vec3 position(int r, int c, double height_m) const {
    const auto row = static_cast<std::size_t>(r), col = static_cast<std::size_t>(c);
    const double radius = kMoonRadius_m + height_m;
    return {radius * cos_lat[row] * cos_lon[col], radius * cos_lat[row] * sin_lon[col], radius * sin_lat[row]};
  }
  std::size_t bytes() const {
    return sizeof(Block) + heights.size() * 4 + normals.size() * 12 + sources.size() * sizeof(SourceMark) +
           8 * 2 * (sin_lat.size() + sin_lon.size());
  }
};

// Fills the sine and cosine tables from the extent.
void fill_trigonometry(Block& block);

}  // namespace selenograph::dem
