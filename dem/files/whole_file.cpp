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
#include <utility>

#include "dem/base/error.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;

// Returns a name for a temporary file next to a file, with this process's number: stale ones are recognised by it.
std::string temporary_name(const std::string& path) {
  static std::atomic<int> counter{0};
  return fmt::format("{}{}{}-{}", path, kTemporaryMark, ::getpid(), counter++);
}

// Calls step(); errors name the file by its final name.
template <typename Step>
void with_name(const std::string& path, const Step& step) {
  try {
    step();
  } catch (const SystemFault& fault) {
    throw SystemFault(path, fault.code());
  }
}

// Writes the folder's entry of a file to disk: without it, a new name may be lost in a crash.
void flush_folder_of(const std::string& path) {
  const fs::path parent = fs::path(path).parent_path();
  const std::string folder = parent.empty() ? "." : parent.string();
  if (::access(folder.c_str(), R_OK) != 0) return;  // a folder that may only be written into cannot be opened
  try {
    OpenFile(folder, O_RDONLY | O_DIRECTORY).write({}, true);
  } catch (const SystemFault& fault) {
    if (fault.code() != EINVAL) throw;  // this file system cannot flush folders
  }
}

}  // namespace

// Another machine's process may have the same number: O_EXCL never opens its file.
WholeFile::WholeFile(std::string path, bool flush) : path_(std::move(path)), flush_(flush) {
  with_name(path_, [&] {
    while (!file_) {
      temporary_ = temporary_name(path_);
      try {
        file_.emplace(temporary_, O_WRONLY | O_CREAT | O_EXCL);
      } catch (const SystemFault& fault) {
        if (fault.code() != EEXIST) throw;
      }
    }
  });
}

WholeFile::~WholeFile() {
  if (!temporary_.empty()) ::unlink(temporary_.c_str());
}

void WholeFile::write(std::string_view bytes) {
  with_name(path_, [&] { file_->write(bytes, false); });
}

void WholeFile::finish() {
  with_name(path_, [&] {
    file_->write({}, flush_);
    if (::rename(temporary_.c_str(), path_.c_str()) != 0) throw SystemFault(path_, errno);
    temporary_.clear();
    if (flush_) flush_folder_of(path_);
  });
}

void write_whole_file(const std::string& path, std::string_view bytes, bool flush) {
  std::error_code no_folder;
  fs::create_directories(fs::path(path).parent_path(), no_folder);
  try {
    WholeFile file(path, flush);
    file.write(bytes);
    file.finish();
  } catch (const SystemFault&) {
    if (no_folder) throw SystemFault(path, no_folder.value());  // report the cause, not the missing folder
    throw;
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
