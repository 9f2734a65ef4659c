// Files that a VRT reads, directly and through nested VRTs. For dem/gdal/ only.
#pragma once

#include <set>
#include <string>

namespace selenograph::dem {

struct VrtSources {
  std::set<std::string> files;    // existing local files that are not VRTs, and remote files, all allowed
  std::set<std::string> missing;  // local files that do not exist: gaps that cannot be read
  bool rescales = false;          // an element of a VRT computes other values from samples
};

// Returns the sources of a VRT; empty for another file. Throws DataError naming `path` when a source is neither a local
// file nor allowed, or when the VRT exceeds the limits in dem/files/products.md. Also when a source exists but is not a
// regular file with content: a FIFO or a device would block.
VrtSources vrt_sources(const std::string& path);

}  // namespace selenograph::dem
