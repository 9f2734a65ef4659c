// Settings from four places: command line, then environment, then configuration file, then the default.
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "api/message/limits.h"
#include "dem/posts/layer_joins.h"
#include "engine/visibility/meshes/mesh_reader.h"
#include "server/service/log.h"
#include "server/service/memory_plan.h"
#include "server/service/pages.h"

namespace CLI {
class App;
class Validator;
}  // namespace CLI

namespace selenograph::server {

// Settings of every command that reads terrain.
struct TerrainSettings {
  std::vector<std::string> dem;  // files and folders; empty: the sample terrain, made in the cache folder
  std::string cache_dir;         // see default_cache_dir()
  MemorySettings memory;
  int threads = 0;                         // 0: all cores
  std::string assets_dir;                  // folder of assets; empty: none
  std::vector<std::string> remote_prefix;  // prefixes of remote names that may be read; empty: none
  std::size_t ground_disk_mb = 0;          // of made ground in the cache folder; 0: none
  double mesh_s = std::chrono::duration<double>(engine::MeshReaderOptions{}.time).count();
  std::string on_data_error = "fail";                  // or "fall-through"
  double blend_posts = dem::LayerJoins{}.blend_posts;  // see LayerJoins
  std::vector<std::string> layer_offset;               // "PATTERN=METRES" or "PATTERN=fit"
  std::vector<std::string> resolved_posts;             // "PATTERN=POSTS" or "PATTERN=fit"
  std::vector<std::string> take_as_heights;            // names of rasters, as patterns: see dem::take_as_heights
  bool strict = false;                                 // a file in a DEM folder that is not a DEM is an error
  std::string log_level = "info";                      // debug, info, warning, error
};

struct ServeSettings {
  TerrainSettings terrain;
  api::Limits limits;
  std::string host = "127.0.0.1";
  int port = 8080;
  int max_frames = 0;     // requests processed at once; 0: number of cores
  int max_waiting = 256;  // a waiting request costs a connection, a thread and its body
  int max_connections = 256;
  double idle_timeout_s = 30, receive_timeout_s = 20;
  double send_kb_per_s = 64;            // minimum rate of reading an answer, KiB/s on average after ten seconds
  double shutdown_s = 10;               // from SIGTERM to the end of the process
  double drain_s = 0;                   // part of it in which requests are still accepted
  PageAccess page = PageAccess::local;  // who may open the pages
  LogFormat log_format = LogFormat::text;
  std::vector<std::string> trusted_proxy;  // addresses, beside loopback, whose token header is trusted
  std::vector<std::string> allowed_host;   // names and addresses, beside `host`, accepted in Host
  bool pretouch = false;                   // touch the budgets' memory at the start
  bool trial = false;
};

void add_options(CLI::App& command, TerrainSettings& settings);
void add_options(CLI::App& command, api::Limits& limits);
void add_options(CLI::App& command, ServeSettings& settings);

// Refuses what is no number from `low` to `high`, NaN too: CLI::Range lets that through.
CLI::Validator number_in(double low, double high);

// Converts a setting in seconds.
std::chrono::milliseconds milliseconds(double seconds);

// $XDG_CACHE_HOME/selenograph, else ~/.cache/selenograph, else /tmp/selenograph-cache.
std::string default_cache_dir();

using ReadVariable = std::function<std::optional<std::string>(const std::string& name)>;
std::optional<std::string> environment_variable(const std::string& name);

// "--cache-mb" is SELENOGRAPH_CACHE_MB in the environment and `cache-mb` in the file.
std::string variable_name(const std::string& option);

// Gives every option of a parsed `command` that was not on the command line its value from the environment or, failing
// that, from the TOML file named by --config or SELENOGRAPH_CONFIG. (CLI11 would let the file win over the
// environment.)
//  - Lists (`dem`) are separated by ':' in the environment ("[fd00::1]" is one item), arrays in the file.
//  - `known` holds the options of all commands: one file may serve them all. A member that no command has is an error.
// Throws CLI::ParseError (as the command line does) naming the variable, or file and member.
void complete_from_environment_and_file(CLI::App& command, const std::set<std::string>& known,
                                        const ReadVariable& variable);

// Long option names of a command, without "--"; help, version and config are not settings.
std::set<std::string> option_names(const CLI::App& command);

}  // namespace selenograph::server
