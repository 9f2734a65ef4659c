// GDAL as it is used here. Within dem/gdal/ only: no other folder includes a header of GDAL.
#pragma once

#include <gdal_priv.h>
#include <ogr_spatialref.h>

#include <memory>
#include <string>

namespace selenograph::dem {

// Before anything else of GDAL; works once per process.
void register_gdal();

// Keeps GDAL's complaints off stderr and hands them to our exceptions. For this thread, while it lives.
class QuietGdal {
 public:
  QuietGdal() {
    CPLPushErrorHandler(CPLQuietErrorHandler);
    CPLErrorReset();
  }
  ~QuietGdal() { CPLPopErrorHandler(); }
  QuietGdal(const QuietGdal&) = delete;
  QuietGdal& operator=(const QuietGdal&) = delete;

  std::string complaint() const {
    const std::string text = CPLGetLastErrorMsg();
    return text.empty() ? "GDAL gives no reason" : text;
  }
};

struct DatasetCloser {
  void operator()(GDALDataset* d) const {
    const QuietGdal quiet;
    GDALClose(d);
  }
};
using DatasetPtr = std::unique_ptr<GDALDataset, DatasetCloser>;

}  // namespace selenograph::dem
