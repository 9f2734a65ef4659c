// DEM file as GDAL reads it: stored pixels, and their conversion to heights. For dem/gdal/ only.
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

// Position of a PDS product's samples in its data file.
struct PdsPixels {
  std::string data_path;
  std::uint64_t first_byte = 0, row_bytes = 0, bytes_needed = 0;
  bool little_endian = false;
};

// File with its state before anything was read from it.
struct FileSeen {
  std::string path;
  FileState state;
};

// An open DEM file, and everything that converts its samples to heights.
struct RasterFile {
  RasterInfo info;
  // All local files that the raster is read from, including a VRT's sources, with their state before anything was read.
  std::vector<FileSeen> files;
  std::optional<FileState> on_server;  // state of a remote file before anything was read
  GDALDataType type = GDT_Unknown;
  // height_m = sample * scale + offset
  double scale = 1, offset_m = 0;
  std::vector<double> voids;            // samples that mean no data
  bool flip_x = false, flip_y = false;  // stored east to west, south to north
  int file_width = 0, file_height = 0;
  std::optional<PdsPixels> pds;
  DatasetPtr dataset;                  // null for PDS3
  std::unique_ptr<RawRasterBand> raw;  // PDS3 only, once open
  GDALRasterBand* band = nullptr;
  GDALRasterBand* mask = nullptr;   // mask of the dataset: 0 where a sample is void; null: it has none
  std::unique_ptr<OpenFile> posts;  // PDS3 in int16 only, once open: read without GDAL
};

// Treatment of a file whose data are missing or truncated: an error, or a description as far as its label allows.
enum class Damage { refuse, describe };

struct RasterReading {
  const RasterInfo* inspected =
      nullptr;  // result of an earlier inspection, so that the samples need no examination; or null
  Damage damage = Damage::refuse;
};
// Opens a file as far as its description needs. Throws DataError, SystemFault.
RasterFile describe_raster_file(const std::string& path, const RasterReading& reading);

// Returns true if the raster's files are unchanged, so that everything read so far is theirs. A change during a read
// shows in the change time even if the modification time was reset.
bool is_current(const RasterFile& file);

// Opens the band of a PDS3 file that was only described so far.
void open_band(RasterFile& file);

// Reads file pixels (x, y, w, h) as double, row-major; NaN where the dataset's mask marks a void.
void read_samples(RasterFile& file, int x, int y, int w, int h, double* out);

// Reads heights in metres, NaN for no-data; `stride`: floats from one row of `out` to the next. Only for a file whose
// posts are stored in reading order: not flipped, PDS3 in int16 (`posts` is open).
void read_posts(const RasterFile& file, int x, int y, int w, int h, float* out, std::size_t stride);

// Returns true if a sample is NaN or one of the file's void values.
bool is_void(const RasterFile& file, double sample);

}  // namespace selenograph::dem
