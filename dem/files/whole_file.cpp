#include "dem/files/whole_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <system_error>

#include "dem/base/error.h"
#include "dem/files/open_file.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;

// Returns a name for a temporary file next to a file, with this process's number: stale ones are recognised by it.
std::string temporary_name(const std::string& path) {
  static std::atomic<int> counter{0};
  return fmt::format("{}.tmp-{}-{}", path, ::getpid(), counter++);
}

// Temporary file, unlinked with this object unless it was renamed.
class Temporary {
 public:
  Temporary(const std::string& path, std::string_view bytes, bool flush = true) : name_(temporary_name(path)) {
    std::error_code no_folder;
    fs::create_directories(fs::path(path).parent_path(), no_folder);
    try {
      OpenFile(name_, O_WRONLY | O_CREAT | O_TRUNC).write(bytes, flush);
    } catch (...) {
      ::unlink(name_.c_str());
      if (no_folder) throw SystemFault(path, no_folder.value());  // report the cause, not the missing folder
      throw;
    }
  }
  ~Temporary() {
    if (!name_.empty()) ::unlink(name_.c_str());
  }
  Temporary(const Temporary&) = delete;
  Temporary& operator=(const Temporary&) = delete;

  void rename(const std::string& path) {
    if (::rename(name_.c_str(), path.c_str()) != 0) throw SystemFault(path, errno);
    name_.clear();
  }

 private:
  std::string name_;
};

}  // namespace

void write_whole_file(const std::string& path, std::string_view bytes, bool flush) {
  try {
    Temporary(path, bytes, flush).rename(path);
  } catch (const SystemFault& fault) {
    throw SystemFault(path, fault.code());  // name the file by its final name
  }
}

void remove_stale_temporaries(const std::string& folder, std::string_view mark) {
  std::error_code error;
  for (fs::recursive_directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    const std::string name = it->path().filename().string();
    const std::size_t mark_begin = name.find(mark);
    if (mark_begin == std::string::npos) continue;
    const pid_t owner = static_cast<pid_t>(std::strtol(name.c_str() + mark_begin + mark.size(), nullptr, 10));
    std::error_code ignored;
    // Files with our own number are stale, too: this process has not written yet, so an earlier one with this number
    // did (in a container each is process 1).
    const bool dead = owner <= 0 || owner == ::getpid() || (::kill(owner, 0) != 0 && errno == ESRCH);
    if (dead) fs::remove(it->path(), ignored);
  }
}

}  // namespace selenograph::dem
