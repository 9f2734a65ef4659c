// The files that a VRT reads, by itself and by VRTs among them. Within dem/gdal/ only.
#pragma once

#include <set>
#include <string>

namespace selenograph::dem {

struct VrtSources {
  std::set<std::string> files;  // of this machine that are there and are no VRTs themselves
  bool remote = false;          // some are on a network, and allowed
};

// Nothing for a file that isn't a VRT. Throws DataError naming `path` where a source is neither a file of this machine
// nor allowed, where it is there and is something else than a regular file with content (a FIFO or a device would be
// waited for), and where the VRT asks for more than is reasonable: see the limits in dem/files/products.md.
VrtSources vrt_sources(const std::string& path);

}  // namespace selenograph::dem
