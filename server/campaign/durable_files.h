// Crash-safe files: replaced atomically, and a journal whose written lines are never lost. All functions
// throw std::system_error naming the file and the system's reason.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace selenograph::server {

// Returns the path of a file in a folder.
inline std::string in_folder(const std::string& folder, const std::string& name) {
  return (std::filesystem::path(folder) / name).string();
}

// Writes a new file; it is on disk when this returns. It is removed on failure.
void write_to_disk(const std::string& path, std::string_view bytes);

// Renames `from` to `to`, which it replaces; on disk when this returns.
void rename_on_disk(const std::string& from, const std::string& to);

// Writes a file under a temporary name beside it, and then renames it: after a crash, too, the path names the old file
// or the new one.
void replace_on_disk(const std::string& path, std::string_view bytes);

// Removes a file; it stays removed after a crash.
void remove_on_disk(const std::string& path);

// An append-only file with this process as its only writer. The constructor creates it if missing, and locks it; it
// throws if another process holds the lock. File systems without locks only cause a warning.
class GrowingFile {
 public:
  explicit GrowingFile(std::string path);
  ~GrowingFile();
  GrowingFile(const GrowingFile&) = delete;
  GrowingFile& operator=(const GrowingFile&) = delete;

  const std::string& path() const { return path_; }
  std::uint64_t size() const { return size_; }
  // Appends bytes; on disk when this returns. On failure a partial append is truncated. Throws, too, if the path no
  // longer names this file: the bytes would be lost, and the lock would not exclude other processes.
  void append(std::string_view bytes);
  void cut(std::uint64_t size);
  // Returns up to `count` bytes from `offset`; fewer at the end.
  std::string read(std::uint64_t offset, std::size_t count) const;

 private:
  [[noreturn]] void fail(int error) const;
  bool is_at_its_path() const;
  std::string path_;
  int file_ = -1;
  std::uint64_t size_ = 0;
};

}  // namespace selenograph::server
