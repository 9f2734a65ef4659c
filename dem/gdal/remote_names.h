// Names in GDAL's network file systems (/vsicurl/, /vsis3/ and the like), and the prefixes that may be read.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace selenograph::dem {

// Allows the files and folders with these names, and everything below them, to be read directly and as sources of VRTs,
// e.g. "/vsicurl/https://example.org/dem". Call it before anything is opened; the default, an empty list, allows none.
void allow_remote_files(const std::vector<std::string>& prefixes);

// Returns true if a name refers to a remote file or a file in an archive, in GDAL's notation.
bool is_remote(const std::string& path);
// Returns true if a name has an allowed prefix and does not leave it by "..".
bool is_allowed(std::string_view name);

}  // namespace selenograph::dem
