// `selenograph ask`: writes the bytes that POST /v1/CALL answers, without a socket; those of a large map tile by tile:
//
//   OUT/request.json            what the tiles are of
//   OUT/tile-00000-00001.tif    row 0, column 1; a file that exists is whole and is not made again
//   OUT/map.vrt                 all tiles, once they exist
#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "api/endpoints/routes.h"
#include "api/message/json_text.h"
#include "api/message/problem.h"
#include "api/message/version.h"
#include "api/requests/map_json.h"
#include "api/service.h"
#include "dem/gdal/mosaic.h"
#include "server/campaign/plan.h"
#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/request_file.h"
#include "server/commands/start.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kCalls = "/v1/";  // paths of all calls begin so

constexpr std::pair<std::string_view, std::string_view> kSuffixes[] = {
    {".npz", "application/x-npz"}, {".json", "application/json"}, {".csv", "text/csv"},
    {".tif", "image/tiff"},        {".tiff", "image/tiff"},       {".png", "image/png"},
    {".exr", "image/x-exr"},       {".npy", "application/x-npy"}, {".raw", "application/octet-stream"}};

const api::Route& route_of(const std::string& call) {
  return *std::ranges::find_if(api::kRoutes, [&](const api::Route& route) {
    return route.has_body() && route.path.substr(kCalls.size()) == call;
  });
}

// Returns the header Accept for an output: the media type of its suffix, or any for standard output. Throws
// std::runtime_error if the call has no such answer.
std::string accept_for(const std::string& output, const std::string& call) {
  const std::string suffix = fs::path(output).extension().string();
  if (suffix.empty() && is_standard_output(output)) return "*/*";
  const api::Limits limits;
  api::Operation operation(limits);
  route_of(call).describe(operation);
  const auto& media_types = operation.json.at("responses").at("200").at("content");
  std::string suffixes;
  for (const auto& [name, media_type] : kSuffixes) {
    if (!media_types.contains(media_type)) continue;
    if (name == suffix) return std::string(media_type);
    suffixes += (suffixes.empty() ? "" : ", ") + std::string(name);
  }
  throw std::runtime_error(fmt::format("{}: the name must end in one of {} for {}", output, suffixes, call));
}

// Warnings of the answers to a request; each is printed once.
class Warnings {
 public:
  void add(const api::Response& answer) {
    for (const auto& [name, value] : answer.headers) {
      if (name == "Selenograph-Warnings")
        for (const api::Json& text : api::Json::parse(value)) texts_.insert("warning: " + text.get<std::string>());
      if (name == "Selenograph-Missing-Fraction") missing_fraction_ = std::max(missing_fraction_, std::stod(value));
    }
  }
  void print(std::FILE* stream, const std::string& output) const {
    if (missing_fraction_ > 0)
      fmt::print(stream, "{}: a share of {:.6g} of the pixels is without data: black, NaN or 65535 there\n", output,
                 missing_fraction_);
    for (const std::string& text : texts_) fmt::print(stream, "{}: {}\n", output, text);
  }

 private:
  std::set<std::string> texts_;
  double missing_fraction_ = 0;  // of the answer with the largest
};

// A request to a service inside the command.
struct Question {
  const api::Service& service;
  const AskSettings& settings;

  // Writes the answer to a body. Returns nothing after printing a refusal.
  std::optional<api::Response> write(std::string body, const std::string& accept, const std::string& path,
                                     const std::function<void(double)>& on_progress) const {
    const bool is_npz = fs::path(settings.request).extension() == ".npz";
    api::Request request;
    request.method = "POST";
    request.path = std::string(kCalls) + settings.call;
    request.headers = {{"accept", accept}, {"content-type", is_npz ? "application/x-npz" : "application/json"}};
    request.body = std::move(body);
    request.on_progress = on_progress;
    api::Response answer = service.handle(request);
    if (answer.status != 200) {
      print_problem(answer);
      return std::nullopt;
    }
    write_whole(path, answer.body);
    return answer;
  }
};

// --- tiles

struct Tile {
  api::MapWindow window;
  std::string path;
};

// Returns a map's tiles, row by row from the north-west.
std::vector<Tile> tiles_of(const dem::MapGrid& map, int side_px, const std::string& folder) {
  std::vector<Tile> tiles;
  for (int y = 0; y < map.height; y += side_px)
    for (int x = 0; x < map.width; x += side_px) {
      const std::string name = fmt::format("tile-{:05}-{:05}.tif", y / side_px, x / side_px);
      tiles.push_back({{x, y, std::min(side_px, map.width - x), std::min(side_px, map.height - y)},
                       (fs::path(folder) / name).string()});
    }
  return tiles;
}

// Returns the request for a tile.
std::string request_for(const Tile& tile, api::Json body) {
  const auto& [x_px, y_px, width_px, height_px] = tile.window;
  body["map"]["window"] = {{"x_px", x_px}, {"y_px", y_px}, {"width_px", width_px}, {"height_px", height_px}};
  return body.dump();
}

// Returns the grid of a request's map. Throws std::runtime_error for a request that has no tiles.
dem::MapGrid grid_of_tiles(const api::Json& body) {
  if (!body.is_object() || !body.contains("map")) throw std::runtime_error("--tile-px: the request has no \"map\"");
  if (body["map"].contains("window")) throw std::runtime_error("--tile-px: the request has a \"window\" of its own");
  api::Limits limits = command_limits();
  limits.max_map_pixels = std::numeric_limits<std::int64_t>::max();  // only a tile is in memory
  return api::read_grid(body, limits);
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
bool write_tiles(const Question& question, const std::string& text, std::uint64_t terrain_fingerprint) {
  const AskSettings& settings = question.settings;
  const api::Json body = api::parse_json(text);
  const std::vector<Tile> tiles = tiles_of(grid_of_tiles(body), settings.tile_px, settings.output);
  claim_folder(settings.output, {{"software", api::software_version()},
                                 {"terrain", fmt::format("{:016x}", terrain_fingerprint)},
                                 {"tile_px", settings.tile_px},
                                 {"call", settings.call},
                                 {"request", body}});
  const Shard shard = shard_of(settings.shard);
  const std::size_t count = (tiles.size() + shard.of - 1 - shard.index) / shard.of;
  ProgressBar bar;
  Warnings warnings;
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
    const auto answer = question.write(request_for(tile, body), "image/tiff", tile.path, show);
    if (!answer) return false;
    warnings.add(*answer);
  }
  fmt::print("{}: {} tiles made, {} existed\n", settings.output, count - existing, existing);
  warnings.print(stdout, settings.output);
  std::vector<std::string> paths;
  for (const Tile& tile : tiles) paths.push_back(tile.path);
  if (std::ranges::all_of(paths, [](const std::string& path) { return fs::exists(path); }))
    dem::write_mosaic((fs::path(settings.output) / "map.vrt").string(), paths);
  return true;
}

bool write_file(const Question& question, std::string text, const std::string& output, const std::string& accept) {
  ProgressBar bar;
  const auto answer = question.write(std::move(text), accept, output, [&](double share) { bar.show(share, output); });
  if (!answer) return false;
  std::FILE* const messages = stream_for_messages(output);
  fmt::print(messages, "{}: {} bytes\n", output, answer->body.size());
  Warnings warnings;
  warnings.add(*answer);
  warnings.print(messages, output);
  return true;
}

}  // namespace

std::vector<std::string> ask_calls() {
  std::vector<std::string> calls;
  for (const api::Route& route : api::kRoutes)
    if (route.has_body()) calls.emplace_back(route.path.substr(kCalls.size()));
  return calls;
}

int ask(const AskSettings& settings) {
  const TerrainSettings& terrain = settings.terrain;
  set_up_log(terrain.log_level);
  const std::string output = settings.output == "-" ? "/dev/stdout" : settings.output;
  const bool has_tiles = settings.tile_px > 0;
  const std::string accept = has_tiles ? "" : accept_for(output, settings.call);
  if (!has_tiles) check_can_be_written(output);
  std::string text = read_request(settings.request);
  const auto renderer = make_renderer(terrain);
  const api::Service service(renderer, command_limits(), terrain.assets_dir, mesh_options(terrain));
  const Question question{service, settings};
  try {
    const bool done = has_tiles ? write_tiles(question, text, renderer->terrain().catalogue().fingerprint())
                                : write_file(question, std::move(text), output, accept);
    return done ? 0 : 1;
  } catch (const api::RequestError& e) {
    throw std::runtime_error(settings.request + ": " + with_findings(e));
  }
}

}  // namespace selenograph::server
