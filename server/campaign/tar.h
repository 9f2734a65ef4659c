// Reproducible tar files: ustar, no times, no owners, so that the bytes depend on the members only. All of libarchive
// is behind this pair of files.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

namespace selenograph::server {

// A member: header, content, padding. A tar is a sequence of members, followed by tar_end().
inline constexpr std::uint64_t kTarHeaderBytes = 512;
std::string tar_member(const std::string& name, std::string_view content);
std::string tar_end();

// Calls `each` for the members of a tar in order; returns the SHA-256 of the whole file. Throws std::runtime_error
// naming the file when it cannot be read or is not a complete tar.
std::string read_tar(
    const std::string& path,
    const std::function<void(const std::string& name, std::uint64_t bytes, const std::string& sha256)>& each);

}  // namespace selenograph::server
