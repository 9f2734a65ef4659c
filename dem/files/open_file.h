// Open file descriptor.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "dem/files/files.h"

namespace selenograph::dem {

// Writes all bytes to a descriptor, however often it takes only a part of them or a signal interrupts. Returns 0, or
// the errno of the failure.
int write_all(int descriptor, std::string_view bytes);

// Owns a file descriptor. Errors of opening, reading and writing are the system's: this class does not check the
// content. Reading is thread-safe.
class OpenFile {
 public:
  // Opens a regular file, or with O_DIRECTORY a folder, and never waits. `flags` as in open(2). Throws SystemFault
  // naming the path, DataError for a FIFO, device or socket.
  OpenFile(std::string path, int flags);
  ~OpenFile();
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;

  // Reads `bytes` bytes at `offset`. Returns false when the file is too short. Throws SystemFault.
  bool read(std::uint64_t offset, std::size_t bytes, void* out) const;
  // Writes all bytes and, with `flush`, flushes them to the disk. Throws SystemFault.
  void write(std::string_view bytes, bool flush = true) const;
  FileState state() const;
  // Waits until no other process holds the file's lock, and takes it until this object ends. Has no effect in a file
  // system without locks.
  void lock() const;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  int fd_;
};

}  // namespace selenograph::dem
