#include "dem/gdal/remote_files.h"

#include <optional>

#include "dem/base/error.h"
#include "dem/gdal/gate.h"
#include "dem/gdal/library.h"
#include "dem/gdal/remote_names.h"

namespace selenograph::dem {

FileState remote_state(const std::string& path) {
  register_gdal();
  if (!is_allowed(path)) throw DataError(path, "is not a file on this machine, and not allowed by --remote-prefix");
  const QuietGdal quiet;
  if (const std::optional<FileState> state = state_on_server(path)) return *state;
  throw_remote_trouble();
  throw DataError(path, "cannot be read from its server");
}

}  // namespace selenograph::dem
