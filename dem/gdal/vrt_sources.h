// The files that a VRT reads, directly and through nested VRTs. Within dem/gdal/ only.
#pragma once

#include <set>
#include <string>

namespace selenograph::dem {

struct VrtSources {
  std::set<std::string> files;    // existing local files that are not VRTs
  std::set<std::string> missing;  // local files that are not there: gaps that can't be read
  bool remote = false;            // some are remote and allowed
  bool rescales = false;          // elements of a VRT compute other values from samples
};

// Empty for a file that is not a VRT. Throws DataError naming `path` when a source is neither a local file nor allowed,
// when it exists but is not a regular file with content (a FIFO or a device would block), or when the VRT exceeds the
// limits in dem/files/products.md.
VrtSources vrt_sources(const std::string& path);

}  // namespace selenograph::dem
