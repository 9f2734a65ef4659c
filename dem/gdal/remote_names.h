// Names of GDAL's network file systems (/vsicurl/, /vsis3/ and the like), and which of them may be read.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace selenograph::dem {

// Names that begin like one of these may be read, by themselves and by VRTs that name them as sources, e.g.
// "/vsicurl/https://example.org/dem/". Before anything is opened; empty, the default: none.
void allow_remote_files(const std::vector<std::string>& prefixes);

// Whether a name is one of GDAL's, of a file that is not on this machine, or in an archive.
bool is_remote(const std::string& path);
// Whether a name begins with an allowed prefix, and does not leave it by "..".
bool is_allowed(std::string_view name);

}  // namespace selenograph::dem
