// Joins GeoTIFF files into one map.
#pragma once

#include <span>
#include <string>

namespace selenograph::dem {

// Writes a VRT of files that have the same projection, pixels and bands; the file names them relative to its folder if
// they lie there. Bands keep their names. Written atomically. Throws DataError naming the file.
void write_mosaic(const std::string& path, std::span<const std::string> files);

}  // namespace selenograph::dem
