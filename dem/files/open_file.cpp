#include "dem/files/open_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <utility>

#include "dem/base/error.h"

namespace selenograph::dem {

int write_all(int descriptor, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(descriptor, bytes.data(), bytes.size());
    if (written < 0 && errno != EINTR) return errno;
    if (written > 0) bytes.remove_prefix(static_cast<std::size_t>(written));
  }
  return 0;
}

// O_NONBLOCK: opening a FIFO would otherwise wait for its other end.
OpenFile::OpenFile(std::string path, int flags)
    : path_(std::move(path)), fd_(::open(path_.c_str(), flags | O_CLOEXEC | O_NONBLOCK | O_NOCTTY, 0666)) {
  if (fd_ < 0) throw SystemFault(path_, errno);
  struct stat s {};
  if (::fstat(fd_, &s) == 0 && (flags & O_DIRECTORY ? S_ISDIR(s.st_mode) : S_ISREG(s.st_mode))) return;
  ::close(fd_);
  throw DataError(path_, "is not a regular file");
}

OpenFile::~OpenFile() { ::close(fd_); }

bool OpenFile::read(std::uint64_t offset, std::size_t bytes, void* out) const {
  for (std::size_t done = 0; done < bytes;) {
    const ssize_t n = ::pread(fd_, static_cast<char*>(out) + done, bytes - done, static_cast<off_t>(offset + done));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw SystemFault(path_, errno);
    if (n == 0) return false;
    done += static_cast<std::size_t>(n);
  }
  return true;
}

void OpenFile::write(std::string_view bytes, bool flush) const {
  if (const int error = write_all(fd_, bytes)) throw SystemFault(path_, error);
  if (flush && ::fsync(fd_) != 0) throw SystemFault(path_, errno);
}

FileState OpenFile::state() const {
  struct stat s {};
  if (::fstat(fd_, &s) != 0) throw SystemFault(path_, errno);
  return state_from(s);
}

void OpenFile::lock() const {
  while (::flock(fd_, LOCK_EX) != 0 && errno == EINTR) continue;
}

}  // namespace selenograph::dem
