// Names in GDAL's network file systems (/vsicurl/, /vsis3/ and the like), and access control by prefix.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace selenograph::dem {

// Allows names with one of these prefixes to be read, by themselves and as sources of VRTs, e.g.
// "/vsicurl/https://example.org/dem/". Call before anything is opened; empty, the default: none.
void allow_remote_files(const std::vector<std::string>& prefixes);

// Whether a name refers to a remote file or a file in an archive, in GDAL's notation.
bool is_remote(const std::string& path);
// Whether a name has an allowed prefix and does not leave it by "..".
bool is_allowed(std::string_view name);

}  // namespace selenograph::dem
