// Opens terrain and creates the renderer from the settings.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "dem/detail/detail.h"
#include "dem/sample/sample_terrain.h"
#include "dem/terrain/pyramid_terrain.h"
#include "engine/renderer.h"
#include "engine/support/confined_reader.h"
#include "server/commands/config.h"

namespace selenograph::server {

// Returns the folder of the sample terrain, in the cache folder; writes it unless it is complete.
std::string sample_folder(const std::string& cache_dir, const dem::SampleOptions& options);

// Returns settings.dem, or the folder of the default sample terrain.
std::vector<std::string> dem_paths(const TerrainSettings& settings);

// Opens the catalogue of the settings. Throws DataError.
dem::Catalogue open_catalogue(const TerrainSettings& settings);
// Opens the terrain, and logs the files that were found and those that cannot be used. Throws DataError.
std::shared_ptr<dem::PyramidTerrain> open_terrain(const TerrainSettings& settings);
std::shared_ptr<const engine::Renderer> make_renderer(const TerrainSettings& settings);

// Reads a detail of the assets folder. Throws std::runtime_error if there is none of that name, DataError if it is
// invalid.
std::shared_ptr<const dem::Detail> detail_of(const std::string& name, const TerrainSettings& settings);

// Returns options for reading meshes and images by child processes of this executable.
engine::ReaderOptions mesh_options(const TerrainSettings& settings);

}  // namespace selenograph::server
