// A map of a quantity over the Moon's surface (albedo, temperature), averaged over a pixel's footprint.
//
// The map is bilinear between the centres of its texels. Level 0 of its pyramid is the raster. A texel of level n is
// the mean of the valid texels among 2 x 2 of level n - 1, with their share. Where the raster has an overview of a
// level's size, texels come from it, without shares. Tiles of levels are made on demand.
//
//      +-------------+       footprint of a pixel: sides a and b around its centre
//     / .   .   .   /        .  probes: bilinear values of the level whose texels are at most half the shorter side;
//    / .   .   .   / b          their mean is the footprint's
//   +-------------+
//          a
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/gdal/value_raster.h"
#include "dem/value_maps/value_map_kernels.h"

namespace selenograph::dem {

// Cache of tiles, shared by maps, on one memory budget.
class ValueMapTiles;
std::shared_ptr<ValueMapTiles> make_value_map_tiles(std::size_t bytes);

// Thread-safe: const functions may be called concurrently.
class ValueMap {
 public:
  // Throws DataError naming the file when it cannot be opened, has no georeferencing, or is not on the Moon's sphere.
  // Projected rasters are warped to geographic coordinates.
  ValueMap(const ValueMapOptions& options, std::shared_ptr<ValueMapTiles> tiles);
  ~ValueMap();
  ValueMap(ValueMap&&) noexcept;

  const std::string& path() const;
  // Hash of the file's path and stamp, and of the options.
  std::uint64_t fingerprint() const;
  // Returns whether the file is unchanged since it was opened.
  bool current() const;
  const std::optional<RadianceFactor>& radiance_factor() const;

  // Returns a number that follows from the map: the first call computes it, later calls return the same.
  std::optional<double> once(const std::function<std::optional<double>()>& number) const;

  // Footprint of a pixel: a parallelogram around a position, by its sides in metres (east, north).
  struct Footprint2 {
    double lat_deg, lon_deg;
    std::array<double, 2> a_m, b_m;
    double cos_lat = cosine(lat_deg);  // callers that have it already may pass it
    static double cosine(double lat_deg);
  };

  // Samples a map for one thread. Caches the latest tiles.
  class Sampler {
   public:
    // `stop` must outlive this object.
    Sampler(const ValueMap& map, const StopToken& stop) : map_(&map), stop_(&stop) {}
    // Mean over the valid area of the footprint (NaN if there is none), and the share of that area, 0 to 1.
    struct Mean {
      double value, coverage;
    };
    // Computes the mean with up to 16 probes along the longer side. Throws DataError when the file cannot be read,
    // Cancelled when `stop` is set.
    Mean mean(const Footprint2& footprint);
    // Computes, for the footprints with a bit in `requested` (at least one), the means of those whose sides are no
    // longer than a texel and that lie between valid texels of one tile, as most near the ground do (small_means).
    // Returns one bit per computed mean; other `values` are undefined. The tile is that of the first requested
    // footprint.
    std::uint32_t means_of_small(const Footprints& footprints, std::uint32_t requested, double* values);

   private:
    std::uint32_t means_in_tile(const Footprints& footprints, std::uint32_t requested, double* values);
    std::uint32_t means_between_tiles(const Footprints& footprints, std::uint32_t requested, double* values);
    struct CachedTile {
      int level = -1, tx = 0, ty = 0;
      std::shared_ptr<const std::vector<float>> tile;
    };
    struct Sum {
      double value, weight;
    };
    Sum bilinear(double x, double y, int level);
    const std::vector<float>& tile(int tx, int ty, int level);
    Sum texel(int x, int y, int level);

    const ValueMap* map_;
    const StopToken* stop_;
    std::array<CachedTile, 16> cached_tiles_;  // direct-mapped by the low bits of tx, ty and level
  };

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace selenograph::dem
