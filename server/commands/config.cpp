#include "server/commands/config.h"

#include <arpa/inet.h>
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <map>
#include <stdexcept>

#include "dem/base/names.h"
#include "dem/posts/layer_joins.h"
#include "dem/posts/resolved_posts.h"

namespace selenograph::server {
namespace {

// Options that neither the environment nor a file can set.
const std::set<std::string> kNotSettings{"help", "version", "config"};

// Returns an option's name without "--"; empty for a positional one.
std::string long_name(const CLI::Option& option) {
  return option.get_lnames().empty() ? std::string() : option.get_lnames().front();
}

// Adds options of files, folders and memory.
void add_files_and_memory(CLI::App& command, TerrainSettings& s) {
  // MemoryPlan decides (memory_plan.h).
  const std::string memory_default = "; default: a share of the memory, at most 1024";
  s.cache_dir = default_cache_dir();
  command.add_option("--config", "Read options from this file, with lines such as cache-mb = 2048")
      ->type_name("FILE")
      ->check(CLI::ExistingFile);
  command.add_option("--dem", s.dem, "Use these DEM files and folders; default: sample terrain")
      ->type_name("PATH ...")
      ->expected(1, 1 << 20);
  command
      .add_option("--assets-dir", s.assets_dir,
                  "Look up files that requests refer to by name in this folder: see deploy/assets/README.md")
      ->type_name("DIR")
      ->check(CLI::ExistingDirectory);
  command
      .add_option(
          "--remote-prefix", s.remote_prefix,
          "Allow remote DEMs with this name or below it, e.g. /vsicurl/https://example.org/dem/; default: local files "
          "only")
      ->type_name("PREFIX ...")
      ->expected(1, 1 << 20);
  command
      .add_option("--mesh-mb", s.memory.mesh_mb,
                  "Limit the memory for reading one object mesh or table of lines of sight, and for cached meshes, "
                  "star catalogues and other assets, MiB" +
                      memory_default)
      ->check(CLI::Range(16, 1 << 24));
  command.add_option("--cache-dir", s.cache_dir, "Keep pyramids in this folder")->type_name("DIR");
  command
      .add_option("--ground-disk-mb", s.ground_disk_mb,
                  "Keep ground with detail on up to this much disk in the cache folder, MiB, for later and other "
                  "processes; 0: none")
      ->check(CLI::Range(0, 1 << 24));
  command.add_option("--cache-mb", s.memory.cache_mb, "Limit the memory for terrain, MiB" + memory_default)
      ->check(CLI::Range(16, 1 << 24));
  command
      .add_option("--scene-mb", s.memory.scene_mb,
                  "Limit the memory for acceleration structures and rendering buffers, MiB" + memory_default)
      ->check(CLI::Range(16, 1 << 24));
}

// Returns the parser's error; empty: none.
std::string refusal_of(const std::string& text, dem::NamedNumber (*parse)(const std::string&)) {
  try {
    parse(text);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return {};
}

// Returns the error of a text that is not a numeric address; empty: none.
std::string refusal_of_address(const std::string& text) {
  in6_addr address{};
  const bool numeric =
      ::inet_pton(AF_INET, text.c_str(), &address) == 1 || ::inet_pton(AF_INET6, text.c_str(), &address) == 1;
  return numeric ? std::string() : text + " is not an IP address";
}

// Returns the error of a text that is not a host; empty: none.
std::string refusal_of_host(const std::string& text) {
  return dem::consists_of(text, "._-:[]") ? std::string()
                                          : text + " is not a host name or address (without scheme and port)";
}

// Adds options of access to the service and its pages, and of the log.
void add_access(CLI::App& command, ServeSettings& s) {
  const std::map<std::string, PageAccess> access{
      {"off", PageAccess::off}, {"local", PageAccess::local}, {"on", PageAccess::on}};
  command.add_option("--page", s.page, "Allow nobody, this machine or everybody to open the pages / and /docs")
      ->transform(CLI::CheckedTransformer(access).description("{off,local,on}"))
      ->default_str("local");
  const std::map<std::string, LogFormat> formats{{"text", LogFormat::text}, {"json", LogFormat::json}};
  command
      .add_option("--log-format", s.log_format,
                  "Format the log on stderr as text, or as one JSON object per line, for requests with id, token, "
                  "times and bytes")
      ->transform(CLI::CheckedTransformer(formats).description("{text,json}"))
      ->default_str("text");
  command
      .add_option("--trusted-proxy", s.trusted_proxy,
                  "Trust the header Selenograph-Token from proxies at these addresses, in addition to loopback")
      ->type_name("ADDRESS ...")
      ->check(refusal_of_address)
      ->expected(1, 1 << 20);
  command
      .add_option("--allowed-host", s.allowed_host,
                  "Allow clients to address the service by these names, and their pages to call it, in addition to "
                  "--host, localhost, 127.0.0.1, [::1] and the address to which a connection is made")
      ->type_name("NAME ...")
      ->check(refusal_of_host)
      ->expected(1, 1 << 20);
}

}  // namespace

void add_options(CLI::App& command, TerrainSettings& s) {
  add_files_and_memory(command, s);
  command.add_option("--threads", s.threads, "Render with this many threads; 0: all cores")->check(CLI::Range(0, 4096));
  command
      .add_option("--on-data-error", s.on_data_error, "Fail on a corrupt or missing DEM file, or use the coarser layer")
      ->check(CLI::IsMember({"fail", "fall-through"}));
  command
      .add_option("--blend-posts", s.blend_posts,
                  "Bend each layer towards a finer one in a band of this width, in posts of the coarser one; 0: none")
      ->check(number_in(0.0, 1000.0));
  command
      .add_option("--layer-offset", s.layer_offset,
                  "Add an offset to the heights of files with that name (* and ? as in a shell), m; fit: measure it "
                  "against the coarser layer along the border")
      ->type_name("PATTERN=METRES|fit ...")
      ->expected(1, 1 << 20)
      ->check([](const std::string& text) { return refusal_of(text, dem::parse_layer_offset); });
  command
      .add_option("--resolved-posts", s.resolved_posts,
                  "Set the resolution of files with that name, in posts, below which detail is added; fit: measure it")
      ->type_name("PATTERN=POSTS|fit ...")
      ->expected(1, 1 << 20)
      ->check([](const std::string& text) { return refusal_of(text, dem::parse_resolved_posts); });
  command.add_flag(
      "--strict", s.strict,
      "Treat a file in a DEM folder that is not a DEM, such as an orthoimage, as an error instead of a warning");
  command.add_option("--log-level", s.log_level, "Log lines of at least this level")
      ->check(CLI::IsMember({"debug", "info", "warning", "error"}));
}

void add_options(CLI::App& command, api::Limits& s) {
  const std::chrono::duration<double> deadline = s.default_deadline;
  command
      .add_option_function<double>(
          "--deadline-s", [&s](double seconds) { s.default_deadline = milliseconds(seconds); },
          "Limit the time of a request; clients can ask for less")
      ->check(number_in(0.001, 86400.0))
      ->default_str(fmt::format("{:g}", deadline.count()));
  command
      .add_option_function<std::size_t>(
          "--max-body-kb", [&s](std::size_t kib) { s.max_body_bytes = kib << 10; },
          "Limit the size of a request body, KiB")
      ->check(CLI::Range(1, 1 << 20))
      ->default_str(std::to_string(s.max_body_bytes >> 10));
  command.add_option("--max-image-pixels", s.max_image_pixels, "Limit the pixels of a frame")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 30));
  command.add_option("--max-image-side", s.max_image_side, "Limit the pixels of a frame's side")
      ->check(CLI::Range(1, 65535));
  command.add_option("--max-map-pixels", s.max_map_pixels, "Limit the pixels of a map")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 30));
  command.add_option("--max-samples-per-pixel", s.max_samples_per_pixel, "Limit the samples per pixel of a frame")
      ->check(CLI::Range(1, 65536));
  command.add_option("--max-rays", s.max_rays, "Limit the rays or points of a request, and the craters of an answer")
      ->check(CLI::Range(1, 1 << 24));
  command
      .add_option("--max-lidar-rays", s.max_lidar_rays, "Limit the sub-rays of a lidar's scan: beams times sub_rays")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 32));
}

void add_options(CLI::App& command, ServeSettings& s) {
  add_options(command, s.terrain);
  add_options(command, s.limits);
  command.add_option("--host", s.host, "Listen on this address; put a proxy in front of anything but loopback");
  command.add_option("--port", s.port, "Listen on this port; 0: any free one, which is printed")
      ->check(CLI::Range(0, 65535));
  command
      .add_option("--memory-mb", s.terrain.memory.memory_mb,
                  "Limit all memory, MiB: --cache-mb, --scene-mb, --mesh-mb, active requests and answers. "
                  "0: three quarters of the machine's memory, at most 8192")
      ->check(CLI::Range(0, 1 << 24));
  command.add_option("--max-frames", s.max_frames, "Process this many requests at once; 0: number of cores")
      ->check(CLI::Range(0, 4096));
  command
      .add_option("--max-waiting", s.max_waiting,
                  "Let this many requests wait in the queue; one client alone may fill half of it")
      ->check(CLI::Range(0, 65536));
  command
      .add_option("--max-connections", s.max_connections,
                  "Limit the connections; beyond the limit, only health and metrics are answered")
      ->check(CLI::Range(4, 65536));
  command.add_option("--idle-timeout-s", s.idle_timeout_s, "Limit the time of an idle connection")
      ->check(number_in(0.1, 86400.0));
  command.add_option("--shutdown-s", s.shutdown_s, "Limit the time from SIGTERM to the end of the process")
      ->check(number_in(0.1, 86400.0));
  add_access(command, s);
}

CLI::Validator number_in(double low, double high) {
  const CLI::Range range(low, high);
  const auto refusal = [range](std::string& text) {
    double number = 0;
    if (CLI::detail::lexical_cast(text, number) && std::isnan(number)) return text + " is not a number";
    return range(text);
  };
  return {refusal, range.get_description()};
}

std::chrono::milliseconds milliseconds(double seconds) {
  return std::chrono::milliseconds(static_cast<std::int64_t>(seconds * 1000.0));
}

std::string default_cache_dir() {
  if (const auto xdg = environment_variable("XDG_CACHE_HOME")) return *xdg + "/selenograph";
  if (const auto home = environment_variable("HOME")) return *home + "/.cache/selenograph";
  return "/tmp/selenograph-cache";
}

std::optional<std::string> environment_variable(const std::string& name) {
  const char* value = std::getenv(name.c_str());
  if (!value || !*value) return {};
  return value;
}

std::string variable_name(const std::string& option) {
  std::string name = "SELENOGRAPH_";
  for (const char c : option) name += c == '-' ? '_' : static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return name;
}

std::set<std::string> option_names(const CLI::App& command) {
  std::set<std::string> names;
  for (const CLI::Option* option : command.get_options()) {
    const std::string name = long_name(*option);
    if (!name.empty() && !kNotSettings.count(name)) names.insert(name);
  }
  return names;
}

void complete_options(CLI::App& command) {
  for (CLI::Option* option : command.get_options()) {
    const std::string name = long_name(*option);
    if (!name.empty() && name != "help") option->envname(variable_name(name));
    if (!option->get_default_str().empty()) continue;
    option->capture_default_str();
    if (option->get_default_str() == "[]") option->default_str("");
  }
}

void complete_settings(CLI::App& command, const std::set<std::string>& all_options) {
  // CLI11 has read the environment, but 2.4 drops a value that an option refuses, and lists whose elements are checked.
  for (CLI::Option* option : command.get_options()) {
    const auto value = environment_variable(option->get_envname());
    if (!value || option->count() > 0) continue;
    option->add_result(*value);
    option->run_callback();
  }
  const CLI::Option* option = command.get_option_no_throw("--config");
  if (!option || option->count() == 0) return;
  const auto path = option->as<std::string>();
  try {
    for (const CLI::ConfigItem& item : command.get_config_formatter()->from_file(path))
      if (!all_options.contains(item.fullname()))
        throw CLI::ValidationError(item.fullname(), "is not an option of any command");
    std::ifstream file(path);
    command.allow_extras();           // options of other commands, which CLI11 2.4 counts as left over
    command.parse_from_stream(file);  // sets only options that are empty so far
  } catch (const CLI::ParseError& e) {
    throw CLI::ValidationError(path, e.what());
  }
}

}  // namespace selenograph::server
