// The rows of a global geographic file that are nearest to a pole.
#pragma once

#include <array>
#include <complex>
#include <functional>
#include <mutex>
#include <vector>

#include "dem/files/raster_info.h"

namespace selenograph::dem {

// Posts along such a row are far closer than rows are to each other (1 m and 1.9 km, 16 posts per degree): whatever a
// row has between two posts along a meridian is not resolved, and would be rays that meet in the pole. Of each row only
// waves of two posts of a meridian and longer are kept; shorter ones continue the next row as on a plane, where the
// m-th harmonic of a smooth surface falls with the m-th power of the distance from the pole. The 8 posts around a pole
// are smooth in this way, and over the next 8 the file's own posts return. Thread-safe.
class PolarRows {
 public:
  using ReadRow = std::function<void(int y, float* heights_m)>;  // a whole row

  // Whether a file has all meridians up to a pole.
  static bool any(const RasterInfo& info);
  explicit PolarRows(const RasterInfo& info) : info_(info) {}

  // Smooths those of the rows y0 .. y0 + h-1 of heights[h][w] that are near a pole, or beyond one. Voids remain.
  void smooth(int x0, int y0, int w, int h, float* heights_m, const ReadRow& read) const;

 private:
  struct Ring {
    double posts = 0;  // distance from the pole
    std::vector<std::complex<double>> harmonics;
  };
  struct Pole {
    std::once_flag once;
    std::vector<Ring> rings;  // from the pole; empty: too many voids
  };
  double posts_from_pole(int y, bool north) const;
  std::vector<Ring> rings_at(bool north, const ReadRow& read) const;

  const RasterInfo& info_;
  mutable std::array<Pole, 2> poles_;  // south, north
};

}  // namespace selenograph::dem
