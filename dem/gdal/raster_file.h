// A DEM file as GDAL reads it: pixels as they are stored, and how they become heights. Within dem/gdal/ only.
#pragma once

#include <rawdataset.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dem/files/files.h"
#include "dem/files/open_file.h"
#include "dem/files/raster_info.h"
#include "dem/gdal/library.h"

namespace selenograph::dem {

struct PdsPixels {
  std::string data_path;
  std::uint64_t first_byte = 0, row_bytes = 0, bytes_needed = 0;
  bool little_endian = false;
};

struct FileSeen {
  std::string path;
  FileState state;
};

struct RasterFile {
  RasterInfo info;
  // All files of this machine that it is read from, as they were before anything was read. Of a VRT its sources, too.
  std::vector<FileSeen> files;
  GDALDataType type = GDT_Unknown;
  // height_m = sample * scale + offset
  double scale = 1, offset_m = 0;
  std::vector<double> voids;
  bool flip_x = false, flip_y = false;  // stored east to west, south to north
  int file_width = 0, file_height = 0;
  std::optional<PdsPixels> pds;
  DatasetPtr dataset;                  // of everything that isn't PDS3
  std::unique_ptr<RawRasterBand> raw;  // of PDS3, once open
  GDALRasterBand* band = nullptr;
  std::unique_ptr<OpenFile> posts;  // of PDS3 in int16, once open: read without GDAL
};

// Whether a file whose data are missing or too short is an error, or described as far as its label goes.
enum class Damage { refuse, describe };

// `known`: what an earlier inspection found, so that opening needs no second look at the samples; may be null.
RasterFile describe_raster_file(const std::string& path, const RasterInfo* known, Damage damage);

// Whether its files are what they were: then all that was read until now is theirs. A change during a read shows in the
// time of change even where the times of modification were put back.
bool is_current(const RasterFile& file);

// Opens the band of a PDS3 file that was only described so far.
void open_band(RasterFile& file);

// File pixels (x, y, w, h) as double, row-major.
void read_samples(RasterFile& file, int x, int y, int w, int h, double* out);

// Heights in metres, NaN where there is none; `stride` counts floats from one row of `out` to the next. Only of a file
// whose posts lie as they are read: not flipped, PDS3 in int16 (`posts` is open).
void read_posts(const RasterFile& file, int x, int y, int w, int h, float* out, std::size_t stride);

bool is_void(const RasterFile& file, double sample);

}  // namespace selenograph::dem
