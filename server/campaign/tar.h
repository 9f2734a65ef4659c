// Reproducible tar files: ustar without times and owners, so that the bytes depend on the members only. No other pair
// of files uses libarchive.
//
//   | header | content, padded to 512 | header | content .. | .. | tar_end(): 1024 zeros |
//   |<------- tar_member() --------->|
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

namespace selenograph::server {

// A tar is a sequence of members, each of header, content and padding, and tar_end().
inline constexpr std::uint64_t kTarHeaderBytes = 512;
std::string tar_member(const std::string& name, std::string_view content);
std::string tar_end();

// Calls `each` for the members of a tar in order, and returns the SHA-256 of the file. Throws std::runtime_error
// naming the file when it cannot be read or is not a complete tar.
std::string read_tar(
    const std::string& path,
    const std::function<void(const std::string& name, std::uint64_t bytes, const std::string& sha256)>& each);

}  // namespace selenograph::server
