#include "dem/gdal/remote_files.h"

#include <cpl_vsi.h>

#include <cstdint>

#include "dem/gdal/gate.h"
#include "dem/gdal/library.h"
#include "dem/gdal/remote_names.h"
#include "dem/support/error.h"

namespace selenograph::dem {

FileState remote_state(const std::string& path) {
  register_gdal();
  if (!is_allowed(path)) throw DataError(path, "is not a file on this machine, and not allowed by --remote-prefix");
  const QuietGdal quiet;
  VSIStatBufL state{};
  if (VSIStatExL(path.c_str(), &state, 0) != 0) {
    throw_remote_trouble();
    throw DataError(path, "cannot be read from its server");
  }
  if (VSI_ISDIR(state.st_mode)) throw DataError(path, "is a folder on its server");
  return {static_cast<std::uint64_t>(state.st_size), static_cast<std::int64_t>(state.st_mtime) * 1'000'000'000};
}

}  // namespace selenograph::dem
