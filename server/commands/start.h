// Terrain and renderer as the settings say.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "dem/sample/sample_terrain.h"
#include "dem/terrain/pyramid_terrain.h"
#include "engine/renderer.h"
#include "server/commands/config.h"

namespace selenograph::server {

// Sample terrain in a folder of the cache folder, written there when it is not yet complete.
std::string sample_folder(const std::string& cache_dir, const dem::SampleOptions& options);

// settings.dem, or the folder of the default sample terrain.
std::vector<std::string> dem_paths(const TerrainSettings& settings);

// What is there, and may be opened. Throws DataError.
dem::Catalogue open_catalogue(const TerrainSettings& settings);
// These throw DataError and say in the log what was found, and what could not be used.
std::shared_ptr<dem::PyramidTerrain> open_terrain(const TerrainSettings& settings);
std::shared_ptr<const engine::Renderer> make_renderer(const TerrainSettings& settings);

// Meshes are read by this same executable.
engine::MeshReaderOptions mesh_options(const TerrainSettings& settings);

}  // namespace selenograph::server
