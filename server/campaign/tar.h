// Archives by libarchive, which no other pair of files uses. Tar files are reproducible: ustar without times and
// owners, so that the bytes depend on the members only.
//
//   | header | content, padded to 512 | header | content .. | .. | tar_end(): 1024 zeros |
//   |<------- tar_member() --------->|
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace selenograph::server {

// Both throw std::runtime_error if libarchive fails.
std::string tar_member(const std::string& name, std::string_view content);
std::string tar_end();

struct TarMember {
  std::string name;
  std::uint64_t offset = 0, bytes = 0;  // of the content in the tar
};

// Lists a tar's members without reading their content. Throws std::runtime_error naming the file when it cannot be read
// or is not a complete tar of such members.
std::vector<TarMember> list_tar(const std::string& path);

// Reads all members of a zip archive, an .npz. Throws std::runtime_error with `name` if it is cut short or a checksum
// differs.
void check_zip(std::string_view bytes, const std::string& name);

}  // namespace selenograph::server
