#include "dem/gdal/library.h"

#include <cpl_minixml.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <mutex>
#include <string_view>

#include "dem/error.h"
#include "dem/files.h"
#include "dem/gdal/gate.h"

namespace selenograph::dem {
namespace {

void keep_drivers() {
  CPLSetConfigOption("GDAL_DRIVER_PATH", "disable");  // no plug-ins
  CPLSetConfigOption("GDAL_VRT_ENABLE_PYTHON", "NO");
  GDALAllRegister();
  GDALSetCacheMax64(GIntBig{64} << 20);  // else a twentieth of the machine's memory
  GDALDriverManager& all = *GetGDALDriverManager();
  for (int i = all.GetDriverCount() - 1; i >= 0; --i) {
    GDALDriver* driver = all.GetDriver(i);
    const auto is_this = [&](const char* name) { return name && EQUAL(name, driver->GetDescription()); };
    if (std::none_of(std::begin(kMapDrivers), std::end(kMapDrivers), is_this)) all.DeregisterDriver(driver);
  }
}

// On a network, or in an archive, which is not read either.
bool is_elsewhere(std::string_view name) {
  return !is_allowed(name) && (name.starts_with("/vsi") || name.find("://") != std::string_view::npos);
}

void check_sources(const CPLXMLNode* node, const std::string& path) {
  for (; node; node = node->psNext) {
    const bool names_file = node->eType == CXT_Element &&
                            (EQUAL(node->pszValue, "SourceFilename") || EQUAL(node->pszValue, "SourceDataset"));
    const char* name = names_file ? CPLGetXMLValue(node, nullptr, "") : "";
    if (is_elsewhere(name)) throw DataError(path, std::string("its source ") + name + " is no file on this machine");
    check_sources(node->psChild, path);
  }
}

}  // namespace

void register_gdal() {
  static std::once_flag once;
  std::call_once(once, [] {
    keep_drivers();
    shut_file_systems();
    OSRSetPROJEnableNetwork(FALSE);
  });
}

void check_sources(const std::string& path) {
  constexpr std::size_t kLooksLikeIt = 4096, kLongestVrt = std::size_t{64} << 20;
  if (read_head(path, kLooksLikeIt).find("<VRTDataset") == std::string::npos) return;
  const QuietGdal quiet;
  const std::unique_ptr<CPLXMLNode, void (*)(CPLXMLNode*)> tree(CPLParseXMLString(read_head(path, kLongestVrt).c_str()),
                                                                CPLDestroyXMLNode);
  if (tree) check_sources(tree.get(), path);
}

QuietGdal::QuietGdal() {
  CPLPushErrorHandler(CPLQuietErrorHandler);
  CPLErrorReset();
  forget_remote_trouble();
  errno = 0;
}

void QuietGdal::fail(const std::string& file, const std::string& what) const {
  const int code = errno;
  throw_remote_trouble();  // by the name of the file on the network, which may be another
  const std::string text = CPLGetLastErrorMsg();
  if (is_system_fault(code)) throw SystemFault(file, code);
  // GDAL may have lost the error on its way: without descriptors or memory this throws SystemFault now.
  std::error_code ignored;
  if (std::filesystem::exists(file, ignored)) read_head(file, 1);
  throw DataError(file, what + ": " + (text.empty() ? "GDAL gives no reason" : text));
}

}  // namespace selenograph::dem
