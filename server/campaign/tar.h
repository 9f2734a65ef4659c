// Tar files whose bytes depend on their members alone: ustar, no times, no owners. All of libarchive is behind this
// pair of files.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

namespace selenograph::server {

// Longest name that fits into a plain header.
inline constexpr std::size_t kLongestTarName = 100;

// A member: header, content, padding. A tar is these one after the other, and kTarEnd.
std::string tar_member(const std::string& name, std::string_view content);
std::string tar_end();

// What is in a tar, in its order, and the SHA-256 of the whole file. Throws std::runtime_error naming the file where it
// can't be read or is no whole tar.
std::string read_tar(
    const std::string& path,
    const std::function<void(const std::string& name, std::uint64_t bytes, const std::string& sha256)>& each);

}  // namespace selenograph::server
