// From settings to the things that commands work with.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "dem/terrain.h"
#include "engine/renderer.h"
#include "server/config.h"

namespace selenograph::server {

// To stderr, so that stdout stays for results.
void set_up_log(const std::string& level);

// settings.dem, or the folder of the sample terrain in the cache folder, written there when it is not yet complete.
std::vector<std::string> dem_paths(const TerrainSettings& settings);

// These throw DataError and say in the log what was found, and what could not be used.
std::shared_ptr<dem::Terrain> open_terrain(const TerrainSettings& settings);
std::shared_ptr<const engine::Renderer> make_renderer(const TerrainSettings& settings);

}  // namespace selenograph::server
