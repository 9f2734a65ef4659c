// How GDAL behaves here: for the files that know it.
#pragma once

#include <gdal_priv.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

namespace selenograph::dem {

// Once per process.
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

struct FileState {
  std::uint64_t bytes = 0;
  std::int64_t modified_ns = 0;
};
// Empty: not there, or not a file.
std::optional<FileState> file_state(const std::string& path);

}  // namespace selenograph::dem
