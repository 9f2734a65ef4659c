// One DEM file, opened for reading posts.
//
// Pixel coordinates here are *post* coordinates: (x, y) = (0, 0) is the position of the first post, whatever the
// product's registration (a pixel-is-area product's post lies at its pixel's centre). x grows along a row, y down the
// rows. Heights are metres above the sphere of 1 737 400 m; products given as planetary radius are converted here;
// scale, offset and byte order are obeyed; no-data (DUMMY, NoData, NaN, what can't be a height) reads as NaN.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "dem/files/raster_info.h"

namespace selenograph::dem {

// Reads what a file says about itself without reading posts. Throws DataError naming the file, SystemFault where the
// system or a connection is at fault. `files`: the label and its data are appended; of other formats, the file. What is
// being written is waited for a little: files that change after this have other times than `stamp` is of.
RasterInfo inspect_raster(const std::string& path, std::vector<std::string>* files = nullptr);

// The same for a file whose data are missing or too short, when its label still says what should be where: `damage`
// tells. What needs its posts then fails by its name, instead of finding nothing there.
RasterInfo inspect_damaged_raster(const std::string& path);

// What else but a file decides what it is taken for.
std::string gdal_version();

// An open file. Not for use by two threads at once (GDAL's rule).
class Raster {
 public:
  // Throws DataError: vanished, truncated, changed since `info`; SystemFault: the system or a connection is at fault.
  explicit Raster(const RasterInfo& info);
  ~Raster();
  Raster(Raster&&) noexcept;
  Raster& operator=(Raster&&) noexcept;

  const RasterInfo& info() const;

  // Reads columns x0 .. x0 + w-1 and rows y0 .. y0 + h-1 into heights[h][w] (row-major). Posts outside the file are
  // NaN, except that x wraps on a raster that wraps, and rows just beyond a pole of a global raster continue on the
  // opposite meridian. Throws DataError when the file can't be read, or was not the same until the end; SystemFault as
  // above.
  void read(int x0, int y0, int w, int h, float* heights_m);

  // Whether its files, and those that a VRT is made of, are what they were when this was opened. Files on a network are
  // not asked for: that is one request for each read.
  bool current() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace selenograph::dem
