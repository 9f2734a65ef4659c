#include "dem/gdal_manners.h"

#include <sys/stat.h>

#include <mutex>

namespace selenograph::dem {

void register_gdal() {
  static std::once_flag once;
  std::call_once(once, [] { GDALAllRegister(); });
}

std::optional<FileState> file_state(const std::string& path) {
  struct stat s {};
  if (::stat(path.c_str(), &s) != 0 || !S_ISREG(s.st_mode)) return std::nullopt;
  return FileState{static_cast<std::uint64_t>(s.st_size),
                   static_cast<std::int64_t>(s.st_mtim.tv_sec) * 1'000'000'000 + s.st_mtim.tv_nsec};
}

}  // namespace selenograph::dem
