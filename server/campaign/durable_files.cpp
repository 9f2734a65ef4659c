#include "server/campaign/durable_files.h"

#include <fcntl.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <stdexcept>
#include <system_error>

#include "dem/files/open_file.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail_at(const std::string& path, int error) {
  throw std::system_error(error, std::generic_category(), path);
}

// An open file, closed on destruction.
class Descriptor {
 public:
  Descriptor(const std::string& path, int flags) : file_(::open(path.c_str(), flags | O_CLOEXEC, 0666)) {
    if (file_ < 0) fail_at(path, errno);
  }
  ~Descriptor() { ::close(file_); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int get() const { return file_; }

 private:
  int file_;
};

// Writes the folder's entry of a file to disk: without it, a new name or a removal may be lost in a crash.
void sync_folder_of(const std::string& path) {
  const fs::path parent = fs::path(path).parent_path();
  const std::string folder = parent.empty() ? "." : parent.string();
  if (::access(folder.c_str(), R_OK) != 0) return;  // a folder that may only be written into cannot be opened
  const Descriptor opened(folder, O_RDONLY | O_DIRECTORY);
  // EINVAL: this file system cannot sync folders.
  if (::fsync(opened.get()) != 0 && errno != EINVAL) fail_at(folder, errno);
}

}  // namespace

void write_to_disk(const std::string& path, std::string_view bytes) {
  int error = 0;
  {
    const Descriptor file(path, O_WRONLY | O_CREAT | O_TRUNC);
    error = dem::write_all(file.get(), bytes);
    if (error == 0 && ::fsync(file.get()) != 0) error = errno;
  }
  if (error == 0) return;
  ::unlink(path.c_str());
  fail_at(path, error);
}

void rename_on_disk(const std::string& from, const std::string& to) {
  if (::rename(from.c_str(), to.c_str()) != 0) fail_at(to, errno);
  sync_folder_of(to);
}

void replace_on_disk(const std::string& path, std::string_view bytes) {
  const std::string temporary = path + ".part-" + std::to_string(::getpid());
  write_to_disk(temporary, bytes);
  try {
    rename_on_disk(temporary, path);
  } catch (...) {
    ::unlink(temporary.c_str());
    throw;
  }
}

void remove_on_disk(const std::string& path) {
  if (::unlink(path.c_str()) != 0 && errno != ENOENT) fail_at(path, errno);
  sync_folder_of(path);
}

GrowingFile::GrowingFile(std::string path) : path_(std::move(path)) {
  file_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (file_ < 0) fail(errno);
  // Close the file before each throw: the destructor of an object that is not complete does not run.
  if (::flock(file_, LOCK_EX | LOCK_NB) != 0) {
    const int error = errno;
    if (error == EWOULDBLOCK) {
      ::close(file_);
      throw std::runtime_error(path_ + ": another process writes to it");
    }
    // Some network file systems have no locks.
    spdlog::warn("{}: not locked ({}): two processes must not work on the same shard", path_,
                 std::generic_category().message(error));
  }
  struct stat status {};
  if (::fstat(file_, &status) != 0) {
    const int error = errno;
    ::close(file_);
    fail(error);
  }
  size_ = static_cast<std::uint64_t>(status.st_size);
}

GrowingFile::~GrowingFile() { ::close(file_); }

void GrowingFile::fail(int error) const { fail_at(path_, error); }

bool GrowingFile::is_at_its_path() const {
  struct stat opened {};
  struct stat named {};
  return ::fstat(file_, &opened) == 0 && ::stat(path_.c_str(), &named) == 0 && opened.st_dev == named.st_dev &&
         opened.st_ino == named.st_ino;
}

void GrowingFile::append(std::string_view bytes) {
  if (::lseek(file_, static_cast<off_t>(size_), SEEK_SET) < 0) fail(errno);
  int error = dem::write_all(file_, bytes);
  if (error == 0 && ::fdatasync(file_) != 0) error = errno;
  // Test this only after writing: the file may be removed at any time.
  if (error == 0 && !is_at_its_path())
    throw std::runtime_error(path_ + ": was removed or replaced while it was written");
  if (error != 0) {
    [[maybe_unused]] const int cut = ::ftruncate(file_, static_cast<off_t>(size_));
    fail(error);
  }
  size_ += bytes.size();
}

void GrowingFile::cut(std::uint64_t size) {
  if (::ftruncate(file_, static_cast<off_t>(size)) != 0 || ::fdatasync(file_) != 0) fail(errno);
  size_ = size;
}

std::string GrowingFile::read(std::uint64_t offset, std::size_t count) const {
  std::string bytes(count, '\0');
  std::size_t size = 0;
  while (size < count) {
    const ssize_t n = ::pread(file_, bytes.data() + size, count - size, static_cast<off_t>(offset + size));
    if (n < 0 && errno != EINTR) fail(errno);
    if (n == 0) break;
    if (n > 0) size += static_cast<std::size_t>(n);
  }
  bytes.resize(size);
  return bytes;
}

}  // namespace selenograph::server
