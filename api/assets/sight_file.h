// Reads tables of lines of sight.
#pragma once

#include <cstddef>
#include <string>

#include "engine/camera/sight_table.h"

namespace selenograph::api {

// Reads a TIFF with three floating-point samples a pixel, the direction of a node (engine::SightTable). Throws
// DataError naming the file, also if it has more than `max_bytes` as doubles.
engine::SightTable read_sight_file(const std::string& path, const std::string& name, std::size_t max_bytes);

}  // namespace selenograph::api
