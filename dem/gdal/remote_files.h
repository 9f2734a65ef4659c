// GDAL's network file systems (/vsicurl/, /vsis3/ and the like), which are shut but for what is allowed.
#pragma once

#include <string>
#include <vector>

#include "dem/files/files.h"

namespace selenograph::dem {

// Names that begin like one of these may be read, by themselves and by VRTs that name them as sources, e.g.
// "/vsicurl/https://example.org/dem/". Before anything is opened; empty, the default: none.
void allow_remote_files(const std::vector<std::string>& prefixes);

// Whether a name is one of GDAL's, of a file that is not on this machine, or in an archive.
bool is_remote(const std::string& path);

// What the server says of a file that is allowed; modified_ns is 0 where it says nothing about time. Throws DataError
// where it isn't allowed, or not there, and SystemFault where the server can't be reached or fails.
FileState remote_state(const std::string& path);

}  // namespace selenograph::dem
