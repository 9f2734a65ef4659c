// GDAL as it is used here. Within dem/gdal/ only: no other folder includes a header of GDAL.
#pragma once

#include <gdal_priv.h>
#include <ogr_spatialref.h>

#include <cstdint>
#include <memory>
#include <string>

namespace selenograph::dem {

// Formats of maps, by GDAL's names of their drivers; of DEMs the first two. No others are registered, so that a VRT's
// sources are of these, too. None of them fetches anything.
inline constexpr const char* kMapDrivers[] = {"GTiff", "VRT", "AAIGrid", "PNG", "JPEG", "PDS", "ISIS3", nullptr};
inline constexpr const char* kDemDrivers[] = {"GTiff", "VRT", nullptr};
// Of DEMs on a network: a server's VRT would name files of this machine.
inline constexpr const char* kRemoteDrivers[] = {"GTiff", nullptr};

// GDAL's cache of decoded blocks, of all files together.
inline constexpr std::uint64_t kBlockCache_bytes = std::uint64_t{64} << 20;

// Before anything else of GDAL; works once per process.
void register_gdal();

// Keeps GDAL's complaints off stderr and hands them to our exceptions. For this thread, while it lives.
class QuietGdal {
 public:
  QuietGdal();
  ~QuietGdal() { CPLPopErrorHandler(); }
  QuietGdal(const QuietGdal&) = delete;
  QuietGdal& operator=(const QuietGdal&) = delete;

  // Throws what GDAL complains about: "`file`: `what`: ..." as DataError, SystemFault where the system or a connection
  // is at fault.
  [[noreturn]] void fail(const std::string& file, const std::string& what) const;
};

struct DatasetCloser {
  void operator()(GDALDataset* d) const {
    const QuietGdal quiet;
    GDALClose(d);
  }
};
using DatasetPtr = std::unique_ptr<GDALDataset, DatasetCloser>;

}  // namespace selenograph::dem
