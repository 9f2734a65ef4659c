#include "dem/gdal/library.h"

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <mutex>

#include "dem/base/error.h"
#include "dem/base/library_messages.h"
#include "dem/files/files.h"
#include "dem/gdal/remote_names.h"

namespace selenograph::dem {
namespace {

// Registers the drivers of kMapDrivers only.
void register_drivers() {
  CPLSetConfigOption("GDAL_DRIVER_PATH", "disable");  // no plug-ins
  CPLSetConfigOption("GDAL_VRT_ENABLE_PYTHON", "NO");
  GDALAllRegister();
  GDALSetCacheMax64(kBlockCache_bytes);  // GDAL's default is a twentieth of the machine's memory
  GDALDriverManager& manager = *GetGDALDriverManager();
  for (int i = manager.GetDriverCount() - 1; i >= 0; --i) {
    GDALDriver* driver = manager.GetDriver(i);
    const auto is_this = [&](const char* name) { return name && EQUAL(name, driver->GetDescription()); };
    if (std::any_of(std::begin(kMapDrivers), std::end(kMapDrivers), is_this)) continue;
    manager.DeregisterDriver(driver);
    GDALDestroyDriver(driver);
  }
}

// Sets an option unless the environment has set it.
void set_default(const char* option, const char* value) {
  if (!CPLGetConfigOption(option, nullptr)) CPLSetConfigOption(option, value);
}

// Sets time limits and retries of reads over a network. GDAL's defaults wait for ever and never retry.
void set_network_limits() {
  set_default("GDAL_HTTP_CONNECTTIMEOUT", "10");
  set_default("GDAL_HTTP_TIMEOUT", "60");
  set_default("GDAL_HTTP_LOW_SPEED_TIME", "10");  // below LOW_SPEED_LIMIT bytes/s
  set_default("GDAL_HTTP_LOW_SPEED_LIMIT", "100");
  set_default("GDAL_HTTP_MAX_RETRY", "3");
  set_default("GDAL_HTTP_RETRY_DELAY", "0.25");
  // Disable curl's cache: otherwise failed answers and an older file's bytes outlive the handle that received them.
  CPLSetConfigOption("CPL_VSIL_CURL_NON_CACHED", "/vsi");
}

// Logs messages of threads without a QuietGdal. GDAL's TIFF driver sends libtiff's messages here, too, even those about
// files that GDAL did not open. Debugging messages appear only when CPL_DEBUG asks for them.
void CPL_STDCALL log_message(CPLErr severity, CPLErrorNum, const char* text) {
  if (severity != CE_Debug) pass_to_log("GDAL", text);
}

}  // namespace

void register_gdal() {
  static std::once_flag once;
  std::call_once(once, [] {
    CPLSetErrorHandler(log_message);
    register_drivers();
    set_network_limits();
    OSRSetPROJEnableNetwork(FALSE);
  });
}

QuietGdal::QuietGdal() {
  CPLPushErrorHandler(CPLQuietErrorHandler);
  CPLErrorReset();
  errno = 0;
}

void QuietGdal::fail(const std::string& file, const std::string& what, bool on_network) const {
  const int code = errno;
  const std::string text = CPLGetLastErrorMsg();
  if (on_network || is_remote(file))
    throw SystemFault(file, EREMOTEIO, what + ": " + (text.empty() ? "its server gives no answer" : text));
  if (is_system_fault(code)) throw SystemFault(file, code);
  // Read a byte in case GDAL has lost the error: without descriptors or memory this throws SystemFault.
  std::error_code ignored;
  if (std::filesystem::exists(file, ignored)) read_head(file, 1);
  throw DataError(file, what + ": " + (text.empty() ? "GDAL gives no reason" : text));
}

}  // namespace selenograph::dem
