// Files that outlive a crash: whole or not there, and a journal whose lines are never lost once they are written. All
// of it throws std::runtime_error naming the file and the system's reason.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace selenograph::server {

// A new file with these bytes, on the disk when this returns. Removed again where that fails.
void write_to_disk(const std::string& path, std::string_view bytes);

// `from` under the name `to`, which it replaces; on the disk when this returns.
void rename_on_disk(const std::string& from, const std::string& to);

// Gone, and gone after a crash, too.
void remove_on_disk(const std::string& path);

// A file that grows at its end, and whose only writer is this process: made if it isn't there, and locked. Throws if
// another process has it.
class GrowingFile {
 public:
  explicit GrowingFile(std::string path);
  ~GrowingFile();
  GrowingFile(const GrowingFile&) = delete;
  GrowingFile& operator=(const GrowingFile&) = delete;

  const std::string& path() const { return path_; }
  std::uint64_t size() const { return size_; }
  // Adds the bytes; on the disk when this returns. What was written of them is cut off again where that fails.
  void append(std::string_view bytes);
  void cut(std::uint64_t size);
  // Up to `count` bytes from `offset`; fewer at the end.
  std::string read(std::uint64_t offset, std::size_t count) const;

 private:
  [[noreturn]] void fail(int error) const;
  std::string path_;
  int file_ = -1;
  std::uint64_t size_ = 0;
};

}  // namespace selenograph::server
