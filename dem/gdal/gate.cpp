#include "dem/gdal/gate.h"

#include <cpl_conv.h>
#include <cpl_error.h>
#include <cpl_string.h>
#include <cpl_time.h>
#include <cpl_vsi.h>
#include <cpl_vsi_error.h>
#include <cpl_vsi_virtual.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>

#include "dem/base/error.h"
#include "dem/base/hash.h"
#include "dem/gdal/remote_names.h"

namespace selenograph::dem {
namespace {

// Number of attempts per request. Pauses between them double.
constexpr int kTries = 4;
constexpr std::chrono::milliseconds kFirstPause{250};

std::optional<RemoteTrouble>& trouble_of_this_thread() {
  thread_local std::optional<RemoteTrouble> trouble;
  return trouble;
}

// Restores errno at the end of a scope: libcurl leaves errors of its own sockets behind.
class RestoredErrno {
 public:
  RestoredErrno() = default;
  ~RestoredErrno() { errno = code_; }
  RestoredErrno(const RestoredErrno&) = delete;
  RestoredErrno& operator=(const RestoredErrno&) = delete;

 private:
  int code_ = errno;
};

// Calls attempt(trouble) until it succeeds or the file is gone. Records the last trouble for this thread.
template <typename Try>
bool with_retries(const std::string& name, Try&& attempt) {
  const RestoredErrno restored_errno;
  RemoteTrouble trouble;
  for (int i = 0; i < kTries; ++i) {
    if (i > 0) std::this_thread::sleep_for(kFirstPause * (1 << (i - 1)));
    trouble = {name, {}, false};
    CPLErrorReset();
    VSIErrorReset();
    if (attempt(trouble)) return true;
    if (trouble.gone) break;
  }
  trouble_of_this_thread() = std::move(trouble);
  return false;
}

struct HandleCloser {
  void operator()(VSIVirtualHandle* handle) const {
    const RestoredErrno restored_errno;
    handle->Close();
    delete handle;
  }
};
using HandlePtr = std::unique_ptr<VSIVirtualHandle, HandleCloser>;

// Sets `trouble` from GDAL's message about a failed request of this thread. GDAL's texts are "HTTP response code: 404"
// after opening, else "HTTP response code on URL: 404".
void explain(RemoteTrouble& trouble) {
  const int code = VSIGetLastErrorNo();
  std::string text = VSIGetLastErrorMsg();
  if (text.empty()) text = CPLGetLastErrorMsg();
  const bool http = text.starts_with("HTTP response code");
  trouble.gone = code == VSIE_AWSObjectNotFound || code == VSIE_AWSBucketNotFound ||
                 (http && (text.ends_with(": 404") || text.ends_with(": 410")));
  if (http && text.ends_with(": 0")) text = "no answer";
  trouble.what = trouble.gone   ? "is missing on its server"
                 : text.empty() ? "cannot be read from its server"
                                : "cannot be read from its server: " + text;
}

// File as its server describes it.
struct ServedFile {
  std::string name;  // name after all redirects
  FileState state;
};

// Returns the seconds since 1970 in a header such as "Tue, 03 Mar 2020 10:00:00 GMT"; 0 if it is not a date.
std::int64_t seconds_of(const char* date) {
  std::tm t{};
  int zone = 0, weekday = 0;
  if (!date || !CPLParseRFC822DateTime(date, &t.tm_year, &t.tm_mon, &t.tm_mday, &t.tm_hour, &t.tm_min, &t.tm_sec, &zone,
                                       &weekday))
    return 0;
  t.tm_year -= 1900;
  t.tm_mon -= 1;
  return CPLYMDHMSToUnixTime(&t);
}

// Returns a file's state from the headers of a server's answer.
FileState state_from(const CPLStringList& headers) {
  FileState state;
  // Take the length after the slash if the answer is to a request for the file's first bytes.
  const char* range = headers.FetchNameValue("Content-Range");
  const char* slash = range ? std::strchr(range, '/') : nullptr;
  const char* length = slash ? slash + 1 : headers.FetchNameValueDef("Content-Length", "0");
  state.bytes = std::strtoull(length, nullptr, 10);
  state.modified_ns = seconds_of(headers.FetchNameValue("Last-Modified")) * 1'000'000'000;
  if (const char* tag = headers.FetchNameValue("ETag")) state.identity = hash_of(tag, std::strlen(tag));
  return state;
}

// Describes a file in a file system of GDAL's that has no HTTP headers. Sets `trouble` and returns false on failure.
bool stat_once(VSIFilesystemHandler& behind, const std::string& name, FileState& state, RemoteTrouble& trouble) {
  VSIStatBufL found{};
  constexpr int kAll = VSI_STAT_EXISTS_FLAG | VSI_STAT_NATURE_FLAG | VSI_STAT_SIZE_FLAG | VSI_STAT_SET_ERROR_FLAG;
  if (behind.Stat(name.c_str(), &found, kAll) != 0) {
    // Open a missing file for its error message: Stat() gives none.
    if (CPLGetLastErrorMsg()[0] == '\0') HandlePtr(behind.Open(name.c_str(), "rb", true, nullptr));
    explain(trouble);
    return false;
  }
  state = {static_cast<std::uint64_t>(found.st_size), static_cast<std::int64_t>(found.st_mtime) * 1'000'000'000};
  return true;
}

// Describes a file, following redirects. GDAL follows redirects itself and reports only the last one. The file is then
// read at the target, if that is allowed, and each further redirect from there is checked in the same way.
bool describe_once(VSIFilesystemHandler& behind, const std::string& name, ServedFile& file, RemoteTrouble& trouble) {
  constexpr int kMaxRedirects = 5;
  file.name = name;
  for (int i = 0; i <= kMaxRedirects; ++i) {
    const CPLStringList headers(behind.GetFileMetadata(file.name.c_str(), "HEADERS", nullptr));
    if (headers.empty()) {
      if (VSIGetLastErrorNo() == VSIE_None) return stat_once(behind, file.name, file.state, trouble);
      explain(trouble);
      return false;
    }
    file.state = state_from(headers);
    const char* location = headers.FetchNameValue("Location");
    if (!location) return true;
    file.name = redirected_name(file.name, location);
    if (is_allowed(file.name)) continue;
    trouble.gone = true;
    trouble.what = "is redirected by its server to " + file.name + ", which --remote-prefix does not allow";
    return false;
  }
  trouble.gone = true;
  trouble.what = "is redirected by its server without end";
  return false;
}

// File of a server, read by GDAL's own handle. An answer that is cut short is never handed on: the read is repeated
// with another handle, since GDAL remembers the short answer within one, and then it fails.
class RemoteFile final : public VSIVirtualHandle {
 public:
  RemoteFile(VSIFilesystemHandler* behind, std::string name, const FileState& state, HandlePtr handle)
      : behind_(behind), name_(std::move(name)), bytes_(state.bytes), state_(state), handle_(std::move(handle)) {}

  int Seek(vsi_l_offset offset, int whence) override {
    position_ = whence == SEEK_SET ? offset : whence == SEEK_CUR ? position_ + offset : bytes_ + offset;
    end_ = failed_ = false;
    return 0;
  }
  vsi_l_offset Tell() override { return position_; }
  size_t Read(void* buffer, size_t size, size_t count) override {
    if (size == 0 || count == 0) return 0;
    const vsi_l_offset left = position_ < bytes_ ? bytes_ - position_ : 0;
    const auto bytes = static_cast<size_t>(std::min<vsi_l_offset>(left, size * count));
    if (bytes > 0 && !with_retries(name_, [&](RemoteTrouble& t) { return read_once(buffer, bytes, t); })) {
      failed_ = true;
      return 0;
    }
    end_ = bytes < size * count;
    position_ += bytes;
    return bytes / size;
  }
  size_t Write(const void*, size_t, size_t) override { return 0; }
  int Eof() override { return end_; }
  // These two override GDAL's functions from GDAL 3.10 (Debian 13) on.
  void ClearErr() { end_ = failed_ = false; }
  int Error() { return failed_; }
  int Close() override {
    handle_.reset();
    return 0;
  }

 private:
  // Reads at the position, all bytes or none. Drops the handle after a failure.
  bool read_once(void* buffer, size_t bytes, RemoteTrouble& trouble) {
    if (!handle_ && !open_again(trouble)) return false;
    size_t done = 0;
    if (handle_->Seek(position_, SEEK_SET) == 0) done = handle_->Read(buffer, 1, bytes);
    if (done == bytes) return true;
    explain(trouble);
    trouble.gone = false;  // open_again() finds out whether the file is gone
    if (trouble.what.empty() || done > 0) trouble.what = "cannot be read from its server: its answer was cut short";
    handle_.reset();
    return false;
  }

  // Opens another handle, if the file is still the one that was opened first.
  bool open_again(RemoteTrouble& trouble) {
    ServedFile file;
    if (!describe_once(*behind_, name_, file, trouble)) return false;
    if (file.state != state_) {
      trouble.gone = true;
      trouble.what = "has changed on its server while it was read";
      return false;
    }
    handle_.reset(behind_->Open(file.name.c_str(), "rb", true, nullptr));
    if (!handle_) explain(trouble);
    return handle_ != nullptr;
  }

  VSIFilesystemHandler* behind_;
  std::string name_;
  vsi_l_offset bytes_, position_ = 0;
  FileState state_;  // state when the file was opened
  HandlePtr handle_;
  bool end_ = false, failed_ = false;
};

// File system through which GDAL opens names such as /vsicurl/..: wraps one of GDAL's own (`behind`) and lets only
// allowed names through, for reading.
class Gate final : public VSIFilesystemHandler {
 public:
  explicit Gate(VSIFilesystemHandler* behind) : behind_(behind) {}

  using VSIFilesystemHandler::Open;
  VSIVirtualHandle* Open(const char* name, const char* access, bool, CSLConstList options) override {
    if (!is_allowed(name) || access[0] != 'r' || std::strchr(access, '+')) {
      errno = EACCES;
      return nullptr;
    }
    HandlePtr handle;
    ServedFile file;
    const bool open = with_retries(name, [&](RemoteTrouble& trouble) {
      if (!describe_once(*behind_, name, file, trouble)) return false;
      handle.reset(behind_->Open(file.name.c_str(), access, true, options));
      if (!handle) explain(trouble);
      return handle != nullptr;
    });
    if (!open) return nullptr;
    return new RemoteFile(behind_, name, file.state, std::move(handle));
  }
  int Stat(const char* name, VSIStatBufL* out, int) override {
    const std::optional<FileState> found = state(name);
    if (!found) return -1;
    *out = {};
    out->st_size = static_cast<decltype(out->st_size)>(found->bytes);
    out->st_mtime = found->modified_ns / 1'000'000'000;
    out->st_mode = S_IFREG;
    return 0;
  }
  // Returns a file's state on its server; empty, with the trouble recorded, if there is none.
  std::optional<FileState> state(const char* name) {
    ServedFile file;
    if (!is_allowed(name)) {
      errno = EACCES;
      return std::nullopt;
    }
    if (!with_retries(name, [&](RemoteTrouble& t) { return describe_once(*behind_, name, file, t); }))
      return std::nullopt;
    return file.state;
  }
  // Returns the file alone: a server's listing of its folder would cost a request, or one for each name that might
  // exist.
  char** SiblingFiles(const char* name) override { return CSLAddString(nullptr, CPLGetFilename(name)); }

 private:
  VSIFilesystemHandler* behind_;  // GDAL's own file system, for the life of the process
};

// Sets an option unless the environment has set it. GDAL's defaults wait for ever.
void set_default(const char* option, const char* value) {
  if (!CPLGetConfigOption(option, nullptr)) CPLSetConfigOption(option, value);
}

}  // namespace

std::optional<FileState> state_on_server(const std::string& name) {
  auto* gate = dynamic_cast<Gate*>(VSIFileManager::GetHandler(name.c_str()));
  return gate ? gate->state(name.c_str()) : std::nullopt;
}

const std::optional<RemoteTrouble>& remote_trouble() { return trouble_of_this_thread(); }

void forget_remote_trouble() { trouble_of_this_thread().reset(); }

void throw_remote_trouble() {
  const std::optional<RemoteTrouble>& trouble = remote_trouble();
  if (!trouble) return;
  if (trouble->gone) throw DataError(trouble->file, trouble->what);
  throw SystemFault(trouble->file, EREMOTEIO, trouble->what);
}

// Wraps all file systems but GDAL's memory files. Wrappers are never removed: GDAL's manager cannot remove them.
void shut_file_systems() {
  set_default("GDAL_HTTP_CONNECTTIMEOUT", "10");
  set_default("GDAL_HTTP_TIMEOUT", "60");
  set_default("GDAL_HTTP_LOW_SPEED_TIME", "10");  // below LOW_SPEED_LIMIT bytes/s
  set_default("GDAL_HTTP_LOW_SPEED_LIMIT", "100");
  // Disable curl's cache: otherwise failed answers and an older file's bytes outlive the handle that received them.
  CPLSetConfigOption("CPL_VSIL_CURL_NON_CACHED", "/vsi");
  char** prefixes = VSIGetFileSystemsPrefixes();
  for (char** p = prefixes; p && *p; ++p)  // NOLINT(clang-analyzer-cplusplus.NewDeleteLeaks): the manager keeps them
    if (std::string_view(*p) != "/vsimem/")
      VSIFileManager::InstallHandler(*p, new Gate(VSIFileManager::GetHandler(*p)));  // NOLINT: as GDAL does
  CSLDestroy(prefixes);
}

}  // namespace selenograph::dem
