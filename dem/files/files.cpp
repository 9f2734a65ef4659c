#include "dem/files/files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <limits>
#include <system_error>

#include "dem/base/error.h"
#include "dem/base/hash.h"

namespace selenograph::dem {
namespace {

// Reads to the end of the file, or `max_bytes`, and closes it.
std::string read_and_close(int fd, const std::string& path, std::size_t max_bytes) {
  constexpr std::size_t kFirstRead = 1 << 16;
  std::string bytes;
  std::size_t done = 0;
  int code = 0;
  while (done < max_bytes) {
    if (done == bytes.size()) bytes.resize(std::min(max_bytes, std::max(kFirstRead, 2 * done)));
    const ssize_t n = ::read(fd, bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) code = errno;
    if (n <= 0) break;
    done += static_cast<std::size_t>(n);
  }
  ::close(fd);
  if (code != 0) throw_file_error(path, code);
  bytes.resize(done);
  return bytes;
}

}  // namespace

std::optional<FileState> file_state(const std::string& path) {
  struct stat s {};
  if (::stat(path.c_str(), &s) != 0) {
    if (is_system_fault(errno)) throw SystemFault(path, errno);
    return std::nullopt;
  }
  if (!S_ISREG(s.st_mode)) return std::nullopt;
  return state_from(s);
}

FileState state_from(const struct stat& s) {
  const auto nanoseconds = [](const timespec& t) {
    return static_cast<std::int64_t>(t.tv_sec) * 1'000'000'000 + t.tv_nsec;
  };
  return {static_cast<std::uint64_t>(s.st_size), nanoseconds(s.st_mtim), nanoseconds(s.st_ctim),
          static_cast<std::uint64_t>(s.st_ino)};
}

std::uint64_t stamp_of(const FileState& state) {
  const std::uint64_t facts[] = {state.bytes, static_cast<std::uint64_t>(state.modified_ns),
                                 static_cast<std::uint64_t>(state.changed_ns), state.identity};
  return hash_of(facts, sizeof facts);
}

bool is_system_fault(int code) {
  switch (code) {
    case EMFILE:
    case ENFILE:
    case ENOMEM:
    case ENOBUFS:
    case EIO:
    case EAGAIN:
    case EINTR:
    case ENODEV:
    case ENXIO:
    case ESTALE:
    case ETIMEDOUT:
    case EREMOTEIO:
    case ENOTCONN:
    case EHOSTDOWN:
      return true;
    default:
      return false;
  }
}

void throw_file_error(const std::string& file, int code) {
  if (is_system_fault(code)) throw SystemFault(file, code);
  throw DataError(file, "cannot be opened: " + std::generic_category().message(code));
}

std::string read_head(const std::string& path, std::size_t max_bytes) {
  // O_NONBLOCK: opening a FIFO would otherwise wait for its writer.
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
  if (fd < 0) throw_file_error(path, errno);
  struct stat s {};
  if (::fstat(fd, &s) != 0 || !S_ISREG(s.st_mode)) {
    ::close(fd);
    throw DataError(path, "is not a regular file");
  }
  return read_and_close(fd, path, std::min(max_bytes, static_cast<std::size_t>(s.st_size)));
}

std::string read_whole(const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOCTTY);
  if (fd < 0) throw_file_error(path, errno);
  return read_and_close(fd, path, std::numeric_limits<std::size_t>::max());
}

}  // namespace selenograph::dem
