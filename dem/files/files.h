// State of files, and errors of opening and reading them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

struct stat;

namespace selenograph::dem {

// State of a file by which a change is recognised.
struct FileState {
  std::uint64_t bytes = 0;
  std::int64_t modified_ns = 0;  // 0: the file's server does not report it
  // Time of the last change of content, name, owner or mode. Unlike modified_ns it cannot be set. 0: the file is on a
  // network.
  std::int64_t changed_ns = 0;
  std::uint64_t identity = 0;  // inode; 0: the file is on a network
  bool operator==(const FileState&) const = default;
};
// Returns the hash of all members, the key under which everything derived from a file is cached. A file that was
// repaired and then given its old modification time differs in the time of change only.
std::uint64_t stamp_of(const FileState& state);
// Returns a regular file's state; empty if it is missing or not a regular file. Throws SystemFault when the system
// cannot tell.
std::optional<FileState> file_state(const std::string& path);
// Converts a stat structure.
FileState state_from(const struct stat& s);

// Returns true if an errno is the system's fault rather than the file's: no descriptors, no memory, a failing disk or
// network.
bool is_system_fault(int code);
// Throws for a file that could not be opened, read or written: SystemFault when the system is at fault, otherwise
// DataError naming `file`.
[[noreturn]] void throw_file_error(const std::string& file, int code);

// Reads at most the first `max_bytes` of a regular file; other kinds are refused without blocking. Throws as
// throw_file_error.
std::string read_head(const std::string& path, std::size_t max_bytes);
// Reads a file to its end. A pipe is read, too, waiting for its writer. Throws as throw_file_error.
std::string read_whole(const std::string& path);

}  // namespace selenograph::dem
