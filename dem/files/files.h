// State of files, and errors of opening and reading them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

struct stat;

namespace selenograph::dem {

struct FileState {
  std::uint64_t bytes = 0;
  std::int64_t modified_ns = 0;  // 0: the file's server does not say
  // Last change of content, name, owner or mode. Unlike modified_ns it cannot be set. 0: the file is on a network.
  std::int64_t changed_ns = 0;
  std::uint64_t identity = 0;  // inode; of a file on a network the hash of its ETag, 0: it has none
  bool operator==(const FileState&) const = default;
};
// Hash of all members. Whatever is kept of a file is kept under this stamp: a file that was repaired and then given its
// old modification time has the same size and times as before, except for the time of change.
std::uint64_t stamp_of(const FileState& state);
// Empty: missing, or not a file. Throws SystemFault when the system cannot tell.
std::optional<FileState> file_state(const std::string& path);
// State from a stat structure.
FileState state_from(const struct stat& s);

// Whether an errno is the system's fault rather than the file's: no descriptors, no memory, a failing disk or network.
bool is_system_fault(int code);
// Throws for a file that could not be opened, read or written: SystemFault when the system is at fault, otherwise
// DataError naming `file`.
[[noreturn]] void throw_file_error(const std::string& file, int code);

// Reads the first `most` bytes of a regular file; other kinds are refused without blocking. Throws as throw_file_error.
std::string read_head(const std::string& path, std::size_t most);
// Reads a file to its end; a pipe, too, which waits for its writer. Throws as throw_file_error.
std::string read_whole(const std::string& path);

}  // namespace selenograph::dem
