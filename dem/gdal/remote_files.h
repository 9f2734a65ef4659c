// GDAL's network file systems (/vsicurl/, /vsis3/ and the like), which are shut.
#pragma once

#include <string>

namespace selenograph::dem {

// Names that begin like this may be read all the same, by VRTs that name them as sources, e.g.
// "/vsicurl/https://example.org/dem/". Before anything is opened; empty, the default: none.
void allow_remote_files(const std::string& prefix);

}  // namespace selenograph::dem
