// Restricts GDAL on this machine to regular files, whatever names them (a VRT, or a name next to a DEM's).
#include <cpl_vsi.h>
#include <cpl_vsi_virtual.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <iterator>
#include <string>
#include <string_view>

#include "dem/gdal/gate.h"

namespace selenograph::dem {
namespace {

// Limit of text files, which GDAL reads as a whole.
constexpr std::int64_t kMaxText_bytes = std::int64_t{64} << 20;
constexpr std::string_view kTexts[] = {".xml", ".XML", ".prj", ".PRJ"};

// Returns false for files that would block or never end: FIFOs, devices, and files of /proc, which have no size.
bool may_be_read(const char* name) {
  struct stat s {};
  if (::stat(name, &s) != 0) return true;  // let GDAL report a missing file
  const bool text = std::any_of(std::begin(kTexts), std::end(kTexts),
                                [&](std::string_view end) { return std::string_view(name).ends_with(end); });
  return S_ISREG(s.st_mode) && s.st_size > 0 && (!text || s.st_size <= kMaxText_bytes);
}

// Wraps GDAL's own local file system, for the life of the process.
class LocalFiles final : public VSIFilesystemHandler {
 public:
  explicit LocalFiles(VSIFilesystemHandler* behind) : behind_(behind) {}

  using VSIFilesystemHandler::Open;
  VSIVirtualHandle* Open(const char* name, const char* access, bool set_error, CSLConstList options) override {
    if (access[0] == 'r' && !may_be_read(name)) {
      errno = EACCES;
      return nullptr;
    }
    return behind_->Open(name, access, set_error, options);
  }
  int Stat(const char* name, VSIStatBufL* state, int flags) override { return behind_->Stat(name, state, flags); }
  int Unlink(const char* name) override { return behind_->Unlink(name); }
  int Mkdir(const char* name, long mode) override { return behind_->Mkdir(name, mode); }
  int Rmdir(const char* name) override { return behind_->Rmdir(name); }
  char** ReadDirEx(const char* name, int max_count) override { return behind_->ReadDirEx(name, max_count); }
  int Rename(const char* from, const char* to) override { return behind_->Rename(from, to); }
  GIntBig GetDiskFreeSpace(const char* folder) override { return behind_->GetDiskFreeSpace(folder); }
  int SupportsSparseFiles(const char* path) override { return behind_->SupportsSparseFiles(path); }

 private:
  VSIFilesystemHandler* behind_;
};

}  // namespace

void guard_local_files() {
  // NOLINTBEGIN: GDAL keeps it
  VSIFileManager::InstallHandler("", new LocalFiles(VSIFileManager::GetHandler("")));
}
// NOLINTEND

}  // namespace selenograph::dem
