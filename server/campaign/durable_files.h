// Crash-safe files: written as a whole or not at all, and a journal whose written lines are never lost. All functions
// throw std::system_error naming the file and the system's reason.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace selenograph::server {

// Writes a new file; it is on disk when this returns. It is removed on failure.
void write_to_disk(const std::string& path, std::string_view bytes);

// Renames `from` to `to`, which it replaces; on disk when this returns.
void rename_on_disk(const std::string& from, const std::string& to);

// Writes a file under a temporary name beside it, and then renames it: after a crash, too, the path names the old file
// or the new one.
void replace_on_disk(const std::string& path, std::string_view bytes);

// Removes a file; it stays removed after a crash.
void remove_on_disk(const std::string& path);

// An append-only file with this process as its only writer: created if missing, and locked. Throws if another process
// holds the lock; file systems without locks only cause a warning.
class GrowingFile {
 public:
  explicit GrowingFile(std::string path);
  ~GrowingFile();
  GrowingFile(const GrowingFile&) = delete;
  GrowingFile& operator=(const GrowingFile&) = delete;

  const std::string& path() const { return path_; }
  std::uint64_t size() const { return size_; }
  // Appends bytes; on disk when this returns. On failure a partial append is truncated. Throws, too, if the file's name
  // is gone or another file has it: nobody would find the bytes, and the lock would keep nobody out.
  void append(std::string_view bytes);
  void cut(std::uint64_t size);
  // Up to `count` bytes from `offset`; fewer at the end.
  std::string read(std::uint64_t offset, std::size_t count) const;

 private:
  [[noreturn]] void fail(int error) const;
  bool has_its_name() const;
  std::string path_;
  int file_ = -1;
  std::uint64_t size_ = 0;
};

}  // namespace selenograph::server
