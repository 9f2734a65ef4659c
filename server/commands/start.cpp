#include "server/commands/start.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "api/assets/assets.h"
#include "dem/base/error.h"
#include "dem/files/open_file.h"
#include "dem/files/quantity.h"
#include "dem/gdal/remote_names.h"
#include "dem/posts/layer_joins.h"
#include "dem/posts/resolved_posts.h"
#include "dem/sample/sample_terrain.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

// Name of the file that is written last: without it, the generation was interrupted and is repeated (same seed, same
// bytes).
constexpr const char* kComplete = "complete";

// Throws DataError for a folder of --dem without a usable DEM file, with the most likely reason.
void refuse_folder_without_dems(const std::string& path, const dem::Catalogue& catalogue) {
  if (dem::is_remote(path) || !fs::is_directory(path)) return;
  const std::string folder = path.ends_with('/') ? path : path + "/";
  const auto is_in_folder = [&](const auto& file) { return file.path.starts_with(folder); };
  if (std::ranges::any_of(catalogue.rasters(), is_in_folder)) return;
  const auto problem = std::ranges::find_if(catalogue.problems(), is_in_folder);
  if (problem != catalogue.problems().end())
    throw DataError(path, fmt::format("has no usable DEM file: {}: {}", problem->path, problem->what));
  const auto side = std::ranges::find_if(catalogue.side_layers(), is_in_folder);
  if (side != catalogue.side_layers().end())
    throw DataError(path, fmt::format("has no DEM file, only side layers, e.g. {} ({}). {}", side->path, side->kind,
                                      dem::kHowToDeclareHeights));
  throw DataError(path, "has no DEM file: expected .img with .lbl, .tif or .vrt (dem/files/products.md)");
}

}  // namespace

std::string sample_folder(const std::string& cache_dir, const dem::SampleOptions& options) {
  const std::string name = fmt::format("sample-{}-{}-{}-{}x{}-{}", options.seed, options.south_deg, options.west_deg,
                                       options.rows, options.columns, options.posts_per_degree);
  const fs::path folder = fs::path(cache_dir) / name;
  if (fs::exists(folder / kComplete)) return folder.string();
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw DataError(folder.string(), "cannot be created: " + error.message());
  // Lock the folder: a process that starts at the same time would replace files that this one has catalogued.
  const dem::OpenFile lock(folder.string(), O_RDONLY | O_DIRECTORY);
  lock.lock();
  if (fs::exists(folder / kComplete)) return folder.string();  // another process has written it while this one waited
  dem::write_sample_terrain(folder.string(), options);
  spdlog::info("wrote sample terrain to {}", folder.string());
  std::ofstream(folder / kComplete) << "sample terrain, all files written\n";
  return folder.string();
}

std::vector<std::string> dem_paths(const TerrainSettings& settings) {
  if (!settings.dem.empty()) return settings.dem;
  spdlog::info("used sample terrain, which is synthetic: no --dem was given");
  return {sample_folder(settings.cache_dir, {})};
}

dem::Catalogue open_catalogue(const TerrainSettings& settings) {
  dem::allow_remote_files(settings.remote_prefix);
  const std::vector<std::string> paths = dem_paths(settings);
  dem::Catalogue catalogue(paths);
  for (const std::string& path : paths) refuse_folder_without_dems(path, catalogue);
  if (settings.strict)
    for (const dem::CatalogueProblem& problem : catalogue.problems())
      if (problem.unrelated) throw DataError(problem.path, problem.what + " (--strict)");
  // Join the layers, with offsets as given or fitted, and then set the resolution below which detail is added.
  std::vector<dem::NamedNumber> offsets, resolved;
  for (const std::string& text : settings.layer_offset) offsets.push_back(dem::parse_layer_offset(text));
  for (const dem::FittedOffset& fit : dem::join_layers(catalogue, settings.blend_posts, offsets)) {
    const std::string& name = catalogue.rasters()[static_cast<std::size_t>(fit.source)].name;
    if (fit.posts == 0)
      spdlog::warn("{}: offset not fitted: it borders on no coarser layer", name);
    else
      spdlog::info("{}: offset {:+.3f} m fitted, the median of {} posts along its border", name, fit.offset_m,
                   fit.posts);
  }
  for (const std::string& text : settings.resolved_posts) resolved.push_back(dem::parse_resolved_posts(text));
  for (const dem::ResolvedLayer& layer : dem::resolve_posts(catalogue, resolved)) {
    const std::string& name = catalogue.rasters()[static_cast<std::size_t>(layer.source)].name;
    if (layer.posts == 0)
      spdlog::warn("{}: resolution not measured, 1 post assumed: it has few heights, or their steps hide it", name);
    else
      spdlog::info("{}: resolution of {} posts measured", name, layer.posts);
  }
  return catalogue;
}

std::shared_ptr<dem::PyramidTerrain> open_terrain(const TerrainSettings& settings) {
  dem::Catalogue catalogue = open_catalogue(settings);
  spdlog::info("catalogue: {} DEM files", catalogue.rasters().size());
  for (const dem::CatalogueProblem& problem : catalogue.problems())
    spdlog::warn("{}{}: {}", problem.located ? "" : "not used: ", problem.path, problem.what);
  for (const dem::SideLayer& side : catalogue.side_layers())
    spdlog::info("not used: {}: side layer ({})", side.path, side.kind);
  dem::TerrainOptions options;
  options.cache_dir = settings.cache_dir;
  options.ground_disk_bytes = settings.ground_disk_mb << 20;
  options.cache_bytes = plan_memory(settings.memory).cache_mb << 20;
  options.fall_through = settings.on_data_error == "fall-through";
  options.log = [](const std::string& text) { spdlog::warn("{}", text); };
  options.threads = settings.threads;
  return std::make_shared<dem::PyramidTerrain>(std::move(catalogue), options);
}

std::shared_ptr<const engine::Renderer> make_renderer(const TerrainSettings& settings) {
  engine::RendererOptions options;
  options.threads = settings.threads;
  options.scene_bytes = plan_memory(settings.memory).scene_mb << 20;
  return std::make_shared<const engine::Renderer>(open_terrain(settings), options);
}

std::shared_ptr<const dem::Detail> detail_of(const std::string& name, const TerrainSettings& settings) {
  auto detail = api::Assets(settings.assets_dir).detail(name);
  if (!detail)
    throw std::runtime_error(
        fmt::format("--detail {0}: no file details/{0}.json in the assets folder \"{1}\" (--assets-dir)", name,
                    settings.assets_dir));
  return detail;
}

engine::ReaderOptions mesh_options(const TerrainSettings& settings) {
  // Names the running executable, even if its file has been replaced since the start.
  return {"/proc/self/exe", plan_memory(settings.memory).mesh_mb << 20};
}

}  // namespace selenograph::server
