// Settings from four sources, in this order: command line, environment, configuration file, default.
#pragma once

#include <chrono>
#include <cstddef>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "api/message/limits.h"
#include "dem/posts/layer_joins.h"
#include "server/service/front.h"
#include "server/service/log.h"
#include "server/service/memory_plan.h"

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
  int threads = 0;                                     // 0: all cores
  std::string assets_dir;                              // folder of files that requests name; empty: none
  std::vector<std::string> remote_prefix;              // prefixes of remote names that may be read; empty: none
  std::size_t ground_disk_mb = 4096;                   // disk space for ground with detail in the cache folder; 0: none
  std::string on_data_error = "fail";                  // or "fall-through"
  double blend_posts = dem::LayerJoins{}.blend_posts;  // see LayerJoins
  std::vector<std::string> layer_offset;               // "PATTERN=METRES" or "PATTERN=fit"
  std::vector<std::string> resolved_posts;             // "PATTERN=POSTS" or "PATTERN=fit"
  bool strict = false;                                 // treat a file in a DEM folder that is not a DEM as an error
  std::string log_level = "info";                      // debug, info, warning, error
};

struct ServeSettings {
  TerrainSettings terrain;
  api::Limits limits;
  std::string host = "127.0.0.1";
  int port = 8080;
  int max_frames = 0;     // requests processed at once; 0: number of cores
  int max_waiting = 256;  // a waiting request occupies a connection, a thread and its body
  int max_connections = 256;
  double idle_timeout_s = 30;
  double shutdown_s = 10;               // from SIGTERM to the end of the process
  PageAccess page = PageAccess::local;  // who may open the pages
  LogFormat log_format = LogFormat::text;
  std::vector<std::string> trusted_proxy;  // addresses whose token header is trusted, in addition to loopback
  std::vector<std::string> allowed_host;   // names and addresses accepted in Host, in addition to `host`
};

void add_options(CLI::App& command, TerrainSettings& settings);
void add_options(CLI::App& command, api::Limits& limits);
void add_options(CLI::App& command, ServeSettings& settings);

// Returns a validator for numbers from `low` to `high`. It also refuses NaN, which CLI::Range accepts.
CLI::Validator number_in(double low, double high);

// Converts a setting in seconds.
std::chrono::milliseconds milliseconds(double seconds);

// Returns $XDG_CACHE_HOME/selenograph, else ~/.cache/selenograph, else /tmp/selenograph-cache.
std::string default_cache_dir();

std::optional<std::string> environment_variable(const std::string& name);

// Returns an option's name in the environment: SELENOGRAPH_CACHE_MB for "cache-mb".
std::string variable_name(const std::string& option);

// Lets the environment set each option of a command that is not on the command line, where a list is written [a,b], and
// shows the options' defaults in its help. Call it after the options have been added.
void complete_options(CLI::App& command);

// Sets every option of a parsed command that the command line has not set from the environment, else from the file
// named by --config, in CLI11's subset of TOML: name = value, lists as arrays, no sections. `all_options` holds the
// options of all commands, since one file may serve them all; any other member is an error. Throws CLI::ParseError
// naming the file.
void complete_settings(CLI::App& command, const std::set<std::string>& all_options);

// Returns the long option names of a command, without "--" and without help, version and config.
std::set<std::string> option_names(const CLI::App& command);

}  // namespace selenograph::server
