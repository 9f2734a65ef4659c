// A map of a quantity over the Moon's surface (albedo, temperature), averaged over a pixel's footprint.
//
// The map is linear between the centres of its texels. Level 0 of its pyramid is the raster; a texel of level n is the
// mean of the valid ones among 2 x 2 texels of level n - 1, with their share; or it is from the raster's own overview
// of that size, which has no shares. Tiles of levels are made on demand.
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
  // Whether the file is unchanged since it was opened.
  bool current() const;
  const std::optional<RadianceFactor>& radiance_factor() const;

  // A number that follows from the map: that of the first call to return, for all callers.
  std::optional<double> once(const std::function<std::optional<double>()>& number) const;

  // Footprint of a pixel: a parallelogram around a place, by its sides in metres (east, north).
  struct Footprint2 {
    double lat_deg, lon_deg;
    std::array<double, 2> a_m, b_m;
    double cos_lat = cosine(lat_deg);  // may be given if known
    static double cosine(double lat_deg);
  };

  // For one thread: remembers the tiles used last.
  class Sampler {
   public:
    // `stop` must outlive this object.
    Sampler(const ValueMap& map, const StopToken& stop) : map_(&map), stop_(&stop) {}
    // Mean of the valid part of the footprint, and the share of that part, 0 to 1. NaN if there is none.
    struct Mean {
      double value, coverage;
    };
    // Computes the mean with up to 16 probes along the longer side. Throws DataError when the file cannot be read,
    // Cancelled when `stop` says so.
    Mean mean(const Footprint2& footprint);
    // Computes the means of footprints whose sides are no longer than a texel, between valid texels of one tile, as
    // most near the ground are: small_means(). Returns one bit per such footprint; other `values` are undefined. The
    // tile is that of the first `wanted` footprint, of which there must be one.
    std::uint32_t means_of_small(const Footprints& footprints, std::uint32_t wanted, double* values);

   private:
    std::uint32_t means_in_tile(const Footprints& footprints, std::uint32_t wanted, double* values);
    std::uint32_t means_between_tiles(const Footprints& footprints, std::uint32_t wanted, double* values);
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
