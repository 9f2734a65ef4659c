// One DEM file, opened for reading posts. All of GDAL is behind this pair of files, raster_writer.h's and
// value_map.h's, which share gdal_manners.h.
//
// Pixel coordinates here are *post* coordinates: (x, y) = (0, 0) is the position of the first post, whatever the
// product's registration (a pixel-is-area product's post lies at its pixel's centre). x grows along a row, y down the
// rows. Heights are metres above the sphere of 1 737 400 m; products given as planetary radius are converted here;
// scale, offset and byte order are obeyed; a void (DUMMY, NoData, NaN, what can't be a height) reads as NaN.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dem/geodesy.h"

namespace selenograph::dem {

// The Moon's heights lie between -9.1 and +10.8 km. What a file says beyond this is none (infinity, a DUMMY that nobody
// declared, a wrong unit) and reads as a void.
inline constexpr double kFarthestHeight_m = 1e5;

enum class Projection { geographic, polar_stereographic };

// Footprint in degrees of the area where posts are: south <= north; west in [-180, 180), east in (west, west + 360].
struct Footprint {
  double south_deg = 0, north_deg = 0, west_deg = 0, east_deg = 0;
};

struct RasterInfo {
  std::string path;    // as opened (for PDS products, the label)
  std::string name;    // file name without folder and extension: what `source` lists
  std::string format;  // "PDS3 Kaguya", "PDS3 LOLA", "GTiff", ...
  Projection projection = Projection::geographic;
  int width = 0, height = 0;
  double posts_per_degree = 0;   // along a meridian; for a projected raster at the centre of projection
  double post_spacing_m = 0;     // along a meridian on the sphere
  Footprint footprint;           // tight around the posts (outermost posts are on its border)
  bool wraps_longitude = false;  // covers 360 degrees: x is periodic
  // When every post lies at an integer multiple of 2^-n degree (both axes): n. Posts are then copied, never resampled.
  std::optional<int> lattice_level;
  std::string datum;                 // e.g. "sphere 1737.4 km, height" or "planetary radius, converted"
  double quantisation_m = 0;         // step between representable heights (1 for integer metres), 0 for float
  std::optional<double> void_value;  // in file units
  std::uint64_t bytes = 0;           // size of the file(s) that hold the posts
  std::int64_t modified_ns = 0;      // newest modification time of label and data
  std::string damage;                // why the posts can't be read although it is known where they lie; empty: they can
};

// Reads what a file says about itself without reading posts. Throws DataError naming the file.
RasterInfo inspect_raster(const std::string& path);

// The same for a file whose data are missing or too short, when its label still says what should be where: `damage`
// tells. What needs its posts then fails by its name, instead of finding nothing there.
RasterInfo inspect_damaged_raster(const std::string& path);

// An open file. Not for use by two threads at once (GDAL's rule); open one per thread or take turns.
class Raster {
 public:
  explicit Raster(const RasterInfo& info);  // throws DataError: vanished, truncated, changed since `info`
  ~Raster();
  Raster(Raster&&) noexcept;
  Raster& operator=(Raster&&) noexcept;

  const RasterInfo& info() const;

  // Post coordinates of a place (fractional). For a wrapping raster x is in [0, width).
  struct PostXY {
    double x, y;
  };
  PostXY locate(double lat_deg, double lon_deg) const;

  // Reads columns x0 .. x0 + w-1 and rows y0 .. y0 + h-1 into heights[h][w] (row-major). Posts outside the file are
  // NaN, except that x wraps on a raster that wraps, and rows just beyond a pole of a global raster continue on the
  // opposite meridian. Throws DataError when the file can't be read.
  void read(int x0, int y0, int w, int h, float* heights_m);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// `locate` without an open file.
Raster::PostXY locate(const RasterInfo& info, double lat_deg, double lon_deg);

// The inverse: where a post is. height_m is 0.
Geographic place_of_post(const RasterInfo& info, int x, int y);

}  // namespace selenograph::dem
