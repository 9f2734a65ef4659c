// A map of a quantity over the Moon's surface (albedo, temperature), averaged over a pixel's footprint.
//
// Between the middles of its texels it is linear. Level 0 of its pyramid is the raster; a texel of level n is the mean
// of the 2 x 2 texels of level n - 1, as far as they have values, and how much of it that is; or the raster's own
// overview of that size, which doesn't say. Tiles of levels are made when they are needed.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dem/gdal/value_raster.h"
#include "dem/support/stop_token.h"
#include "dem/value_maps/value_map_kernels.h"

namespace selenograph::dem {

// What is in memory of the maps that share it, on one budget in bytes.
class ValueMapTiles;
std::shared_ptr<ValueMapTiles> make_value_map_tiles(std::size_t bytes);

// const means safe to call concurrently.
class ValueMap {
 public:
  // Throws DataError naming the file: it can't be opened, doesn't say where it lies, isn't the Moon's sphere. Projected
  // rasters are warped to degrees on the way.
  ValueMap(const ValueMapOptions& options, std::shared_ptr<ValueMapTiles> tiles);
  ~ValueMap();
  ValueMap(ValueMap&&) noexcept;

  const std::string& path() const;
  // Of the file's path, size and modification time, and of the options.
  std::uint64_t fingerprint() const;
  // Whether the file is still the one that was opened.
  bool current() const;

  // What a pixel covers: a parallelogram around a place, by its sides in metres (east, north).
  struct Footprint2 {
    double lat_deg, lon_deg;
    std::array<double, 2> a_m, b_m;
    double cos_lat = cosine(lat_deg);  // of those that have it at hand
    static double cosine(double lat_deg);
  };

  // For one thread: remembers the tiles that it used last.
  class Sampler {
   public:
    // `stop` outlives it.
    Sampler(const ValueMap& map, const StopToken& stop) : map_(&map), stop_(&stop) {}
    // Of what has a value within the footprint; which share of it that is, 0 to 1. NaN where nothing has.
    struct Mean {
      double value, coverage;
    };
    // Of up to 16 probes along its longer side. Throws DataError when the file can't be read, Cancelled when `stop`
    // says so.
    Mean mean(const Footprint2& footprint);
    // The means of those footprints that are smaller than a texel and within four of one tile that have values, as most
    // are near the ground. A bit for each such one; other `values` mean nothing. The tile is that of the `first` one.
    std::uint32_t means_of_small(const Footprints& footprints, std::size_t first, double* values);

   private:
    struct Held {
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
    std::array<Held, 16> held_;
  };

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace selenograph::dem
