// Opening a file with GDAL, and what is refused before any of its samples is decoded. Within dem/gdal/ only.
#pragma once

#include <cstddef>
#include <string>

#include "dem/gdal/library.h"

namespace selenograph::dem {

// While GDAL opens files, for this thread: no listing of the folder per file (64 800 tiles, or as many sources of a
// VRT), and no source datasets shared between two VRTs opened by one thread, since those may later be read by different
// threads. A VRT's sources are opened when they are read.
class OpenOptions {
 public:
  // `remote`: of a file on a network not even the names of those that may lie beside it are asked for.
  explicit OpenOptions(bool remote) { set(remote ? "EMPTY_DIR" : "TRUE", "FALSE"); }
  ~OpenOptions() { set(nullptr, nullptr); }
  OpenOptions(const OpenOptions&) = delete;
  OpenOptions& operator=(const OpenOptions&) = delete;

 private:
  static void set(const char* no_listing, const char* share) {
    CPLSetThreadLocalConfigOption("GDAL_DISABLE_READDIR_ON_OPEN", no_listing);
    CPLSetThreadLocalConfigOption("VRT_SHARED_SOURCE", share);
  }
};

// Whether a file is met for the first time: then all that it may read is looked at, the sources of a VRT one by one,
// overviews and masks. Of one that was looked at, and has not changed since, only itself.
enum class Look { first, again };

struct OpenDataset {
  DatasetPtr dataset;
  bool remote = false;  // it, or a source of it, is on a network
};

// Throws DataError naming `path`: it can't be opened by one of `drivers`, vrt_sources() refuses it, or one block (tile
// or strip) of it takes more memory than GDAL's cache of blocks has. SystemFault as QuietGdal::fail.
OpenDataset open_dataset(const std::string& path, const char* const* drivers, Look look);

}  // namespace selenograph::dem
