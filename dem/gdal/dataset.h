// Opens files with GDAL, and checks them before any sample is decoded. For dem/gdal/ only.
#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "dem/gdal/library.h"

namespace selenograph::dem {

// Sets GDAL options of this thread while files are opened. They avoid a directory listing per file: there may be 64 800
// tiles, or as many sources of a VRT. VRTs opened by one thread do not share source datasets, since different threads
// may read them later. A VRT's sources are opened when they are read.
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

// Extent of the checks at opening. `first`: everything that the file may read is checked, including each source of a
// VRT, overviews and masks. `again`: the file was checked before and has not changed; only the file itself is checked.
enum class CheckScope { first, again };

// Description of a band's numbers, from the band itself.
struct BandValues {
  std::string unit;                  // the band's unit; empty: it declares none
  std::optional<double> vertical_m;  // metres in the unit of the dataset's vertical coordinate system, if it has one
  double scale = 1, offset = 0;

  bool declares_unit() const { return !unit.empty() || vertical_m; }
  // Returns the unit's name, or its length in metres, for messages.
  std::string unit_name() const;
};
BandValues values_of(GDALDataset& dataset, int band);

struct OpenDataset {
  DatasetPtr dataset;
  bool remote = false;            // the file, or a source of it, is on a network
  std::set<std::string> missing;  // sources of a VRT that do not exist
  // Bands of a VRT's sources; filled by CheckScope::first only.
  std::map<std::string, std::vector<BandValues>> sources;
  bool rescales = false;  // a VRT with elements that compute values from its sources' samples
};

// Opens a dataset. Throws DataError naming `path` if none of `drivers` can open it, or if vrt_sources() rejects it.
// Also if one of its blocks (tiles or strips) exceeds GDAL's block cache. Throws SystemFault as QuietGdal::fail.
OpenDataset open_dataset(const std::string& path, const char* const* drivers, CheckScope scope);

// Returns the mask band, which is 0 where a sample is void; null if the dataset has at most a NoData value.
GDALRasterBand* mask_of(GDALRasterBand& band);

}  // namespace selenograph::dem
