// Files by what their names say, and whether they are still what they were.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

namespace selenograph::dem {

// By the extension, in upper or lower case. A pds_image has its label beside it, or attached.
enum class FileKind { pds_label, pds_image, georeferenced, other };
FileKind kind_of(const std::filesystem::path& path);

// The label beside a PDS image that has none attached.
std::optional<std::string> label_beside(const std::filesystem::path& image);

struct FileState {
  std::uint64_t bytes = 0;
  std::int64_t modified_ns = 0;
};
// Empty: not there, or not a file.
std::optional<FileState> file_state(const std::string& path);

}  // namespace selenograph::dem
