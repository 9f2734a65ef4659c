// Reads tables of lines of sight.
#pragma once

#include <string>

#include "dem/base/stop_token.h"
#include "engine/camera/sight_table.h"
#include "engine/support/confined_reader.h"

namespace selenograph::api {

// First argument of the child process.
inline constexpr const char* kReadSightsCommand = "read-lines-of-sight";
// Called by main() for that argument; returns the exit status.
int read_sights_in_child(int argc, char** argv);

// Reads a TIFF with three floating-point samples a pixel, the direction of a node (engine::SightTable). Throws as
// ConfinedReader::read.
engine::SightTable read_sight_file(const engine::ConfinedReader& reader, const std::string& path,
                                   const std::string& name, const StopToken& stop);

}  // namespace selenograph::api
