// Raster of values in geographic coordinates, read by one of kMapDrivers: bands averaged, no-data as NaN.
#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dem/files/files.h"
#include "dem/files/raster_info.h"

namespace selenograph::dem {

// Geometry and wavelength at which a map's values are I/F: pi times radiance over the Sun's irradiance.
struct RadianceFactor {
  double incidence_deg, emission_deg, phase_deg, wavelength_um;
};

struct ValueMapOptions {
  std::string path;        // in a format listed in the README
  std::vector<int> bands;  // from 1: the value is their mean; empty: all but alpha
  // Outer borders of a raster without georeferencing, row 0 in the north.
  std::optional<Footprint> extent;
  // value = (scale * sample + offset) ^ exponent, after the file's own scale and offset; the exponent undoes a gamma.
  double scale = 1, offset = 0, exponent = 1;
  std::optional<double> no_data;                  // an additional sample value that means no-data
  std::optional<RadianceFactor> radiance_factor;  // if values are I/F; empty: rho, Hapke's w, or kelvin
  double low = std::numeric_limits<double>::lowest(), high = std::numeric_limits<double>::max();  // values are clamped
  // Averages are taken of the values' fourth powers, as of the light that a temperature emits; no value is below 0.
  bool fourth_power = false;
};

// Thread-safe; reads are serialised.
class ValueRaster {
 public:
  // Conversion from pixel corners to degrees: x grows east by dx, y south by dy.
  struct Grid {
    double west_deg, north_deg, dx_deg, dy_deg;
  };
  struct Window {
    int x, y, width, height;
  };

  // Opens a raster. Throws DataError naming the file when it cannot be opened, has no georeferencing, or is not on the
  // Moon's sphere. Projected rasters are warped to geographic coordinates.
  explicit ValueRaster(const ValueMapOptions& options);
  ~ValueRaster();

  int width() const;
  int height() const;
  const Grid& grid() const;
  const std::vector<int>& bands() const;  // averaged bands, from 1
  // Return the state of the file when it was opened, and true if it is unchanged.
  const FileState& state() const;
  bool current() const;

  // Returns the index of the overview of a size; -1: none.
  int overview_of_size(int width, int height) const;
  // Reads the mean of the bands, with the file's scale and offset applied, from an overview, or from the raster (-1).
  // The mean is NaN if one band has no value. `stride`: values from one row of `out` to the next. Throws DataError when
  // the file cannot be read or has changed.
  void read(int overview, const Window& window, int stride, double* out) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace selenograph::dem
