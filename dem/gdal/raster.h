// DEM file, opened for reading posts.
//
//     +-----+-----+-> x      Post coordinates: (0, 0) is the first post, x grows along a row, y down the rows.
//     | 0,0 | 1,0 |          In a pixel-is-area product a post lies at its pixel's centre.
//     +-----+-----+
//     | 0,1 | 1,1 |
//     v y
//
// Heights are metres above the sphere of 1 737 400 m. Planetary radii are converted here; scale, offset and byte order
// are applied. No-data (DUMMY, NoData, a mask, NaN, impossible heights) reads as NaN.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "dem/files/raster_info.h"

namespace selenograph::dem {

// Returns a file's metadata; reads a few posts at most. Throws DataError naming the file, SystemFault when the system
// or a connection is at fault. Appends the label and its data, or the file itself, to `files`. Waits briefly for a file
// that is being written, so that later changes give times other than those in `stamp`.
RasterInfo inspect_raster(const std::string& path, std::vector<std::string>* files = nullptr);

// Returns the metadata of a file whose data are missing or truncated while its label is valid: `damage` gives the
// reason. Requests that need its posts then fail and name it, instead of finding no data.
RasterInfo inspect_damaged_raster(const std::string& path);

// Open file. Not thread-safe (GDAL's rule).
class Raster {
 public:
  // Opens a file. Throws DataError when the file has vanished, is truncated or has changed since `info`; SystemFault
  // when the system or a connection is at fault.
  explicit Raster(const RasterInfo& info);
  ~Raster();
  Raster(Raster&&) noexcept;
  Raster& operator=(Raster&&) noexcept;

  const RasterInfo& info() const;

  // Reads columns x0 .. x0 + w-1 and rows y0 .. y0 + h-1 into heights[h][w] (row-major). Posts outside the file are
  // NaN, with two exceptions. On a raster that wraps, x wraps; rows just beyond a pole of a global raster continue on
  // the opposite meridian. Throws DataError when the file cannot be read or has changed meanwhile; SystemFault as
  // above.
  void read(int x0, int y0, int w, int h, float* heights_m);

  // Returns true if its files, and those of a VRT, are unchanged since it was opened. Remote files are not checked:
  // that would take one request per read.
  bool current() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace selenograph::dem
