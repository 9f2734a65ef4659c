// `selenograph horizons` and `selenograph illumination`: what POST /v1/horizons and POST /v1/illumination answer, as a
// file or, of a large map, as tiles.
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "api/answers/horizons_answer.h"
#include "api/message/json_text.h"
#include "api/message/problem.h"
#include "api/message/version.h"
#include "dem/gdal/mosaic.h"
#include "server/campaign/plan.h"
#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/request_file.h"
#include "server/commands/start.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

constexpr std::pair<std::string_view, std::string_view> kMediaTypes[] = {
    {".tif", "image/tiff"}, {".npz", "application/x-npz"}, {".json", "application/json"}, {".csv", "text/csv"}};

// Returns the media type of the output's extension, one of those that can hold the answer. Throws std::runtime_error.
template <typename Query>
std::string_view media_type_for(const Query& query, std::span<const api::Alternative> alternatives,
                                const std::string& output) {
  const std::string extension = fs::path(output).extension().string();
  std::string names;
  for (const auto& [name, media_type] : kMediaTypes) {
    const bool is_answer = std::any_of(alternatives.begin(), alternatives.end(),
                                       [&](const api::Alternative& a) { return a.media_type == media_type; });
    if (!is_answer || !api::holds(query, media_type)) continue;
    if (name == extension) return media_type;
    names += (names.empty() ? "" : ", ") + std::string(name);
  }
  throw std::runtime_error(
      fmt::format("{}: the name must end in one of {} for {}", output, names, query.area ? "a map" : "places"));
}

// A request and what answers it.
template <typename Query>
struct Work {
  const Query& query;
  const engine::Renderer& renderer;

  // Writes the answer of a query: this one, or that of a tile. Returns false after printing its problem.
  bool write(const Query& of, std::string_view media_type, const std::string& path,
             const engine::HorizonProgress& progress) const {
    const api::Response answer = api::answer_or_problem({}, [&] {
      const auto found =
          renderer.query(of.detail.content, api::MapErrorQuery::of(of.map_error), {},
                         [&](const engine::RenderContext& rendering) { return api::find(of, rendering, progress); });
      api::Response encoded;
      encoded.body = api::encode(of, found, media_type, {});
      return encoded;
    });
    if (answer.status != 200)
      print_problem(answer);
    else
      write_whole(path, answer.body);
    return answer.status == 200;
  }
};

// A rectangle of a map's pixels, and its file.
struct Tile {
  dem::MapGrid grid;
  std::string path;
};

// Returns a map's tiles, row by row from the north-west.
std::vector<Tile> tiles_of(const dem::MapGrid& map, int side_px, const std::string& folder) {
  std::vector<Tile> tiles;
  for (int y = 0; y < map.height; y += side_px)
    for (int x = 0; x < map.width; x += side_px) {
      dem::MapGrid grid = map;
      grid.west_m += x * map.gsd_m;
      grid.north_m -= y * map.gsd_m;
      grid.width = std::min(side_px, map.width - x);
      grid.height = std::min(side_px, map.height - y);
      const std::string name = fmt::format("tile-{:05}-{:05}.tif", y / side_px, x / side_px);
      tiles.push_back({grid, (fs::path(folder) / name).string()});
    }
  return tiles;
}

// Records in a folder what its tiles are of. Throws std::runtime_error if it has tiles of something else.
void claim_folder(const std::string& folder, const nlohmann::ordered_json& what) {
  fs::create_directories(folder);
  const std::string path = (fs::path(folder) / "request.json").string();
  const std::string text = api::json_text(what, 2) + "\n";
  if (!fs::exists(path)) return write_whole(path, text);
  if (read_request(path) != text)
    throw std::runtime_error(folder + " has tiles of another request, terrain or software: see its request.json");
}

// Writes a shard's tiles, and the mosaic if all exist then. Returns false if a tile failed.
template <typename Query>
bool write_tiles(const Work<Query>& work, const TiledSettings& settings) {
  if (!work.query.area) throw std::runtime_error("--tile-px: places have no tiles");
  claim_folder(settings.output, {{"software", api::software_version()},
                                 {"terrain", fmt::format("{:016x}", work.renderer.terrain().catalogue().fingerprint())},
                                 {"tile_px", settings.tile_px},
                                 {"request", api::resolved_json(work.query)}});
  const Shard shard = shard_of(settings.shard);
  const std::vector<Tile> tiles = tiles_of(work.query.grid, settings.tile_px, settings.output);
  const std::size_t count = (tiles.size() + shard.of - 1 - shard.index) / shard.of;
  ProgressBar bar;
  std::size_t existing = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const Tile& tile = tiles[i * shard.of + shard.index];
    const auto show = [&](double share) {
      bar.show((static_cast<double>(i) + share) / static_cast<double>(count), tile.path);
    };
    if (fs::exists(tile.path)) {
      ++existing;
      show(1);
      continue;
    }
    Query query = work.query;
    query.grid = tile.grid;
    if (!work.write(query, "image/tiff", tile.path, show)) return false;
  }
  fmt::print("{}: {} tiles made, {} existed\n", settings.output, count - existing, existing);
  std::vector<std::string> paths;
  for (const Tile& tile : tiles) paths.push_back(tile.path);
  const auto exists = [](const std::string& path) { return fs::exists(path); };
  if (std::all_of(paths.begin(), paths.end(), exists))
    dem::write_mosaic((fs::path(settings.output) / "map.vrt").string(), paths);
  return true;
}

template <typename Query>
bool write_file(const Work<Query>& work, std::span<const api::Alternative> alternatives, const std::string& output) {
  const std::string_view media_type = media_type_for(work.query, alternatives, output);
  ProgressBar bar;
  if (!work.write(work.query, media_type, output, [&](double share) { bar.show(share, output); })) return false;
  std::FILE* messages = stream_for_messages(output);
  fmt::print(messages, "{}: {} {}\n", output, work.query.size(), work.query.area ? "pixels" : "places");
  return true;
}

// Runs a command with the reader of its requests. Returns the exit status.
template <typename Query>
int run(const TiledSettings& settings, std::span<const api::Alternative> alternatives,
        Query (*read)(const api::Json&, const api::Limits&, const api::Assets&, const StopToken&)) {
  set_up_log(settings.terrain.log_level);
  const std::string text = read_request(settings.request);
  const api::Limits limits = command_limits();
  const api::Assets assets(settings.terrain.assets_dir, mesh_options(settings.terrain));
  std::optional<Query> query;
  const api::Response reading = api::answer_or_problem({}, [&] {
    query.emplace(read(api::parse_json(text), limits, assets, {}));
    return api::Response{};
  });
  if (reading.status != 200) {
    print_problem(reading);
    return 1;
  }
  const auto renderer = make_renderer(settings.terrain);
  const Work work{*query, *renderer};
  const bool done =
      settings.tile_px > 0 ? write_tiles(work, settings) : write_file(work, alternatives, settings.output);
  // std::clock() counts all threads of the process, from its start.
  if (done) fmt::print(stderr, "processor time {:.1f} s\n", static_cast<double>(std::clock()) / CLOCKS_PER_SEC);
  return done ? 0 : 1;
}

}  // namespace

int horizons(const HorizonsSettings& settings) { return run(settings, api::kHorizonsAnswers, api::read_horizons); }

int illumination(const IlluminationSettings& settings) {
  return run(settings, api::kIlluminationAnswers, api::read_illumination);
}

}  // namespace selenograph::server
