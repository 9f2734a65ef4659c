// A raster of values in degrees, by one of kMapDrivers: bands averaged, no-data as NaN.
#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dem/files/files.h"
#include "dem/files/raster_info.h"

namespace selenograph::dem {

struct ValueMapOptions {
  std::string path;        // of a format that the README names
  std::vector<int> bands;  // from 1: the value is their mean; empty: all but alpha
  // Of a raster that doesn't say where it lies: its outer borders, row 0 in the north.
  std::optional<Footprint> extent;
  double scale = 1, offset = 0;   // value = scale * sample + offset, after what the file itself says
  std::optional<double> no_data;  // a sample that is none, besides the file's own
  double low = std::numeric_limits<double>::lowest(), high = std::numeric_limits<double>::max();  // values are clamped
};

// Safe to call concurrently; reads take turns.
class ValueRaster {
 public:
  // From pixel corners to degrees: x grows east by dx, y south by dy.
  struct Grid {
    double west_deg, north_deg, dx_deg, dy_deg;
  };
  struct Window {
    int x, y, width, height;
  };

  // Throws DataError naming the file: it can't be opened, doesn't say where it lies, isn't the Moon's sphere. Projected
  // rasters are warped to degrees on the way.
  explicit ValueRaster(const ValueMapOptions& options);
  ~ValueRaster();

  int width() const;
  int height() const;
  const Grid& grid() const;
  const std::vector<int>& bands() const;  // that are averaged, from 1
  // Of the file when it was opened, and whether it is still that.
  const FileState& state() const;
  bool current() const;

  // The index of the overview of that size; -1: there is none.
  int overview_of_size(int width, int height) const;
  // The mean of the bands, after what the file says of scale and offset; NaN where one has no value. Of an overview, or
  // of the raster (-1). `stride` counts values from one row of `out` to the next. Throws DataError when the file can't
  // be read or isn't what it was.
  void read(int overview, const Window& window, int stride, double* out) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace selenograph::dem
