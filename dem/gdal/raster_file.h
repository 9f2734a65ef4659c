// A DEM file as GDAL reads it: stored pixels, and their conversion to heights. Within dem/gdal/ only.
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
  // All local files that it is read from, including a VRT's sources, with their state before anything was read.
  std::vector<FileSeen> files;
  std::optional<FileState> on_server;  // of a remote file, before anything was read
  GDALDataType type = GDT_Unknown;
  // height_m = sample * scale + offset
  double scale = 1, offset_m = 0;
  std::vector<double> voids;
  bool flip_x = false, flip_y = false;  // stored east to west, south to north
  int file_width = 0, file_height = 0;
  std::optional<PdsPixels> pds;
  DatasetPtr dataset;                  // for all formats but PDS3
  std::unique_ptr<RawRasterBand> raw;  // for PDS3, once open
  GDALRasterBand* band = nullptr;
  GDALRasterBand* mask = nullptr;   // the dataset's: 0 where a sample is none; null: it has none
  std::unique_ptr<OpenFile> posts;  // for PDS3 in int16, once open: read without GDAL
};

// Whether a file whose data are missing or truncated is an error, or is described as far as its label allows.
enum class Damage { refuse, describe };

struct RasterReading {
  const RasterInfo* known = nullptr;  // result of an earlier inspection: the samples need no examination; or null
  Damage damage = Damage::refuse;
};
RasterFile describe_raster_file(const std::string& path, const RasterReading& reading);

// Whether its files are unchanged, so that everything read so far is theirs. A change during a read shows in the change
// time even if the modification time was reset.
bool is_current(const RasterFile& file);

// Opens the band of a PDS3 file that has only been described.
void open_band(RasterFile& file);

// Reads file pixels (x, y, w, h) as double, row-major; NaN where the dataset's mask says that there is none.
void read_samples(RasterFile& file, int x, int y, int w, int h, double* out);

// Reads heights in metres, NaN for no-data; `stride`: floats from one row of `out` to the next. Only for a file whose
// posts are stored in reading order: not flipped, PDS3 in int16 (`posts` is open).
void read_posts(const RasterFile& file, int x, int y, int w, int h, float* out, std::size_t stride);

bool is_void(const RasterFile& file, double sample);

}  // namespace selenograph::dem
