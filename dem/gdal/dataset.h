// Opens files with GDAL, and the checks before any sample is decoded. Within dem/gdal/ only.
#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "dem/gdal/library.h"

namespace selenograph::dem {

// GDAL options for this thread while files are opened: no directory listing per file (64 800 tiles, or as many sources
// of a VRT), and no source datasets shared between two VRTs opened by one thread, since those may later be read by
// different threads. A VRT's sources are opened when they are read.
class OpenOptions {
 public:
  // `remote`: for a remote file, not even the names of neighbouring files are requested.
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

// Whether a file is opened for the first time: then everything that it may read is checked, including each source of a
// VRT, overviews and masks. If it was checked before and has not changed, only the file itself.
enum class Look { first, again };

// A band's own description of its numbers.
struct BandValues {
  std::string unit;                  // the band's; empty: it declares none
  std::optional<double> vertical_m;  // metres in the unit of the dataset's vertical coordinate system, if it has one
  double scale = 1, offset = 0;

  bool declares_unit() const { return !unit.empty() || vertical_m; }
  // The unit by its name, or by its length, in messages.
  std::string unit_name() const;
};
BandValues values_of(GDALDataset& dataset, int band);

struct OpenDataset {
  DatasetPtr dataset;
  bool remote = false;            // it, or a source of it, is on a network
  std::set<std::string> missing;  // sources of a VRT that are not there
  // A VRT's sources on this machine and their bands, when it is opened for the first time.
  std::map<std::string, std::vector<BandValues>> sources;
  bool rescales = false;  // a VRT with elements that compute values from its sources' samples
};

// Throws DataError naming `path` when it cannot be opened by one of `drivers`, vrt_sources() rejects it, or one of its
// blocks (tiles or strips) exceeds GDAL's block cache; SystemFault as QuietGdal::fail.
OpenDataset open_dataset(const std::string& path, const char* const* drivers, Look look);

// What a dataset has beside its samples to say which of them are none: 0 there. Null: nothing but NoData, if that.
GDALRasterBand* mask_of(GDALRasterBand& band);

}  // namespace selenograph::dem
