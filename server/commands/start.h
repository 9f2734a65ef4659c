// Makes terrain and renderer from the settings.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "dem/detail/detail.h"
#include "dem/sample/sample_terrain.h"
#include "dem/terrain/pyramid_terrain.h"
#include "engine/renderer.h"
#include "server/commands/config.h"

namespace selenograph::server {

// Folder with the sample terrain, in the cache folder; written if it is not yet complete.
std::string sample_folder(const std::string& cache_dir, const dem::SampleOptions& options);

// settings.dem, or the folder of the default sample terrain.
std::vector<std::string> dem_paths(const TerrainSettings& settings);

// Opens the catalogue of the settings. Throws DataError.
dem::Catalogue open_catalogue(const TerrainSettings& settings);
// Opens the terrain; logs what was found and what could not be used. Throws DataError.
std::shared_ptr<dem::PyramidTerrain> open_terrain(const TerrainSettings& settings);
std::shared_ptr<const engine::Renderer> make_renderer(const TerrainSettings& settings);

// A detail of the assets folder. Throws std::runtime_error if there is none of that name, DataError if it is wrong.
std::shared_ptr<const dem::Detail> detail_of(const std::string& name, const TerrainSettings& settings);

// Options for reading meshes, with this same executable as the reading program.
engine::MeshReaderOptions mesh_options(const TerrainSettings& settings);

}  // namespace selenograph::server
