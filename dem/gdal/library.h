// Set-up and error handling of GDAL. For dem/gdal/ only: no other folder includes a header of GDAL.
#pragma once

#include <gdal_priv.h>
#include <ogr_spatialref.h>

#include <cstdint>
#include <memory>
#include <string>

namespace selenograph::dem {

// Drivers of map formats, by GDAL's names; the first two are also for DEMs. No others are registered, so a VRT's
// sources are restricted to these, too. None of them accesses a network.
inline constexpr const char* kMapDrivers[] = {"GTiff", "VRT", "AAIGrid", "PNG", "JPEG", "PDS", "ISIS3", nullptr};
inline constexpr const char* kDemDrivers[] = {"GTiff", "VRT", nullptr};
// Driver of remote DEMs, and of remote sources of a VRT: a remote VRT could name local files.
inline constexpr const char* kRemoteDrivers[] = {"GTiff", nullptr};

// Size of GDAL's cache of decoded blocks, for all files together.
inline constexpr std::uint64_t kBlockCache_bytes = std::uint64_t{64} << 20;

// Configures GDAL, once per process. Call it before any other use of GDAL.
void register_gdal();

// Redirects GDAL's error messages of this thread from stderr to our exceptions, during its lifetime.
class QuietGdal {
 public:
  QuietGdal();
  ~QuietGdal() { CPLPopErrorHandler(); }
  QuietGdal(const QuietGdal&) = delete;
  QuietGdal& operator=(const QuietGdal&) = delete;

  // Throws GDAL's error message as "`file`: `what`: ...": DataError, or SystemFault when the system or a connection is
  // at fault: always if a file is remote, or `on_network`, which is a VRT with remote sources.
  [[noreturn]] void fail(const std::string& file, const std::string& what, bool on_network = false) const;
};

struct DatasetCloser {
  void operator()(GDALDataset* d) const {
    const QuietGdal quiet;
    GDALClose(d);
  }
};
using DatasetPtr = std::unique_ptr<GDALDataset, DatasetCloser>;

}  // namespace selenograph::dem
