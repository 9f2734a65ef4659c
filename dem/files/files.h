// Files: whether they are still what they were, and why they can't be read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

struct stat;

namespace selenograph::dem {

struct FileState {
  std::uint64_t bytes = 0;
  std::int64_t modified_ns = 0;
  std::int64_t changed_ns = 0;  // of content, name, owner or mode: it can't be set as modified_ns can; 0: unknown
  bool operator==(const FileState&) const = default;
};
// Empty: not there, or not a file. Throws SystemFault where the system can't tell.
std::optional<FileState> file_state(const std::string& path);
// What the system says of a file that is open or named.
FileState state_from(const struct stat& s);

// Whether an error (as in errno) says nothing about the file: no descriptors, no memory, a disk or a network that
// fails.
bool is_system_fault(int code);
// Of a file that could not be opened, read or written: SystemFault where the system is at fault, else DataError naming
// `file`.
[[noreturn]] void throw_file_error(const std::string& file, int code);

// The first `most` bytes of a regular file; others are refused without waiting for them. Throws as throw_file_error.
std::string read_head(const std::string& path, std::size_t most);

}  // namespace selenograph::dem
