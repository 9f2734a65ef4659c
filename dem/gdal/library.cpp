#include "dem/gdal/library.h"

#include <cpl_minixml.h>
#include <cpl_vsi_virtual.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <mutex>
#include <string_view>

#include "dem/error.h"
#include "dem/files.h"

namespace selenograph::dem {
namespace {

std::string& allowed_prefix() {
  static std::string prefix;
  return prefix;
}

bool is_allowed(std::string_view name) {
  const std::string& prefix = allowed_prefix();
  return !prefix.empty() && name.starts_with(prefix);
}

// Stands before a file system of GDAL's and lets through what is allowed, for reading.
class Gate final : public VSIFilesystemHandler {
 public:
  explicit Gate(VSIFilesystemHandler* behind) : behind_(behind) {}

  using VSIFilesystemHandler::Open;
  VSIVirtualHandle* Open(const char* name, const char* access, bool set_error, CSLConstList options) override {
    if (is_allowed(name) && access[0] == 'r') return behind_->Open(name, access, set_error, options);
    errno = EACCES;
    return nullptr;
  }
  int Stat(const char* name, VSIStatBufL* state, int flags) override {
    if (is_allowed(name)) return behind_->Stat(name, state, flags);
    errno = EACCES;
    return -1;
  }

 private:
  VSIFilesystemHandler* behind_;  // GDAL's own, for the life of the process
};

// All but memory, which GDAL itself works with. Handlers are never removed: GDAL's manager has no way to.
void shut_file_systems() {
  char** prefixes = VSIGetFileSystemsPrefixes();
  for (char** p = prefixes; p && *p; ++p)  // NOLINT(clang-analyzer-cplusplus.NewDeleteLeaks): the manager keeps them
    if (std::string_view(*p) != "/vsimem/")
      VSIFileManager::InstallHandler(*p, new Gate(VSIFileManager::GetHandler(*p)));  // NOLINT: as GDAL does
  CSLDestroy(prefixes);
}

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

void allow_remote_files(const std::string& prefix) { allowed_prefix() = prefix; }

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

void QuietGdal::fail(const std::string& file, const std::string& what) const {
  const int code = errno;
  const std::string text = CPLGetLastErrorMsg();
  if (is_system_fault(code)) throw SystemFault(file, code);
  // GDAL may have lost the error on its way: without descriptors or memory this throws SystemFault now.
  std::error_code ignored;
  if (std::filesystem::exists(file, ignored)) read_head(file, 1);
  throw DataError(file, what + ": " + (text.empty() ? "GDAL gives no reason" : text));
}

}  // namespace selenograph::dem
