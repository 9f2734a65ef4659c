#include "dem/gdal/library.h"

#include <mutex>

namespace selenograph::dem {

void register_gdal() {
  static std::once_flag once;
  std::call_once(once, [] { GDALAllRegister(); });
}

}  // namespace selenograph::dem
