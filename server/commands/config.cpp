#include "server/commands/config.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <toml++/toml.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <stdexcept>

#include "dem/posts/layer_joins.h"
#include "dem/posts/resolved_posts.h"
#include "server/http/allowed_hosts.h"

namespace selenograph::server {
namespace {

using Values = std::map<std::string, std::vector<std::string>>;

// Options that neither the environment nor a file can set.
const std::set<std::string> kNotSettings{"help", "version", "config"};

// Returns a TOML value as text, in which the command line would have it. `where` names it in errors.
std::string scalar_text(const toml::node& node, const std::string& where) {
  if (const auto* text = node.as_string()) return text->get();
  if (const auto* number = node.as_integer()) return std::to_string(number->get());
  if (const auto* truth = node.as_boolean()) return truth->get() ? "true" : "false";
  if (const auto* number = node.as_floating_point()) {
    std::ostringstream text;
    text.precision(17);  // enough digits for every double
    text << number->get();
    return text.str();
  }
  throw CLI::ValidationError(where, "must be a string, a number, true, false, or a list of these");
}

// Reads the members of a TOML file as text. Throws CLI::ValidationError naming the file and the member.
Values read_file(const std::string& path, const std::set<std::string>& all_options) {
  if (std::error_code ignored; std::filesystem::is_directory(path, ignored))
    throw CLI::ValidationError(path, "is a folder");
  const toml::parse_result parsed = [&] {
    try {
      return toml::parse_file(path);
    } catch (const toml::parse_error& e) {
      std::ostringstream what;
      what << e.description() << " (line " << e.source().begin.line << ')';
      throw CLI::ValidationError(path, what.str());
    }
  }();
  Values values;
  for (const auto& [key, node] : parsed) {
    const std::string name(key.str()), where = path + ": " + name;
    if (!all_options.count(name)) throw CLI::ValidationError(where, "is not an option of any command");
    if (const toml::array* list = node.as_array()) {
      values[name];  // an empty list is a setting, too
      for (const toml::node& item : *list) values[name].push_back(scalar_text(item, where));
    } else {
      values[name] = {scalar_text(node, where)};
    }
  }
  return values;
}

bool is_list(const CLI::Option& option) { return option.get_items_expected_max() > 1; }

// Returns true if a colon belongs to a URL in the item that begins at `from`: it is before "//", or before the port.
bool is_in_url(const std::string& text, std::size_t from, std::size_t colon) {
  if (text.compare(colon + 1, 2, "//") == 0) return true;
  const std::size_t host = text.rfind("://", colon);
  return host != std::string::npos && host >= from && text.find('/', host + 3) > colon && colon + 1 < text.size() &&
         std::isdigit(static_cast<unsigned char>(text[colon + 1]));
}

// Returns true if a colon belongs to an address in brackets, with which the item at `from` begins: "[fd00::1]".
bool is_bracketed(const std::string& text, std::size_t from, std::size_t colon) {
  return text[from] == '[' && text.find(']', from) != std::string::npos && text.find(']', from) > colon;
}

// Splits a list at colons, like PATH.
std::vector<std::string> split_list(const std::string& text) {
  std::vector<std::string> parts;
  for (std::size_t from = 0; from < text.size();) {
    std::size_t colon = text.find(':', from);
    while (colon != std::string::npos && (is_in_url(text, from, colon) || is_bracketed(text, from, colon)))
      colon = text.find(':', colon + 1);
    const std::size_t end = std::min(colon, text.size());
    if (end > from) parts.push_back(text.substr(from, end - from));
    from = end + 1;
  }
  return parts;
}

// Returns the text of an error. CLI11 reports "not in range" for text that is not a number, too.
std::string error_text(const CLI::Option& option, const std::string& value, const CLI::ParseError& error) {
  const std::string type = option.get_type_name();
  const bool is_integer = type.find("INT") != std::string::npos;
  if (!is_integer && type.find("FLOAT") == std::string::npos) return error.what();
  double number = 0;
  if (!CLI::detail::lexical_cast(value, number)) return value + " is not a number";
  return is_integer && number != std::floor(number) ? value + " is not a whole number" : error.what();
}

// Sets an option from the environment or a file; `origin` names the source in errors.
void set_option(CLI::Option& option, const std::vector<std::string>& values, const std::string& origin) {
  if (values.size() != 1 && !is_list(option)) throw CLI::ValidationError(origin, "takes one value");
  if (values.empty()) return;
  try {
    option.add_result(values);
    option.run_callback();
  } catch (const CLI::ParseError& e) {
    throw CLI::ValidationError(origin, error_text(option, values.front(), e));
  }
}

// Returns an option's name without "--"; empty for a positional one.
std::string long_name(const CLI::Option& option) {
  return option.get_lnames().empty() ? std::string() : option.get_lnames().front();
}

// Returns the path of the configuration file; empty: none.
std::string config_path(CLI::App& command, const ReadVariable& variable) {
  const CLI::Option* option = command.get_option_no_throw("--config");
  if (!option) return {};
  if (option->count() > 0) return option->as<std::string>();
  return variable("SELENOGRAPH_CONFIG").value_or("");
}

// Adds options of files, folders and memory.
void add_files_and_memory(CLI::App& command, TerrainSettings& s) {
  // MemoryPlan decides (memory_plan.h).
  const std::string memory_default = "; default: 1024, or less if that does not fit";
  s.cache_dir = default_cache_dir();
  command.add_option("--config", "Read options from this TOML file, e.g. cache-mb = 2048")->type_name("FILE");
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
      ->each([&s](const std::string&) { s.memory.remote_tiles = true; })
      ->type_name("PREFIX ...")
      ->expected(1, 1 << 20);
  command
      .add_option("--mesh-mb", s.memory.mesh_mb,
                  "Limit the memory for reading one object mesh or table of lines of sight, and for cached meshes, "
                  "star catalogues and other assets, MiB" +
                      memory_default)
      ->check(CLI::Range(16, 1 << 24));
  command.add_option("--cache-dir", s.cache_dir, "Keep pyramids in this folder")
      ->type_name("DIR")
      ->capture_default_str();
  command
      .add_option("--ground-disk-mb", s.ground_disk_mb,
                  "Keep ground with detail on up to this much disk in the cache folder, MiB, for later and other "
                  "processes; 0: none")
      ->check(CLI::Range(0, 1 << 24))
      ->capture_default_str();
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
  return is_host(text) ? std::string() : text + " is not a host name or address (without scheme and port)";
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
  command.add_option("--threads", s.threads, "Render with this many threads; 0: all cores")
      ->check(CLI::Range(0, 4096))
      ->capture_default_str();
  command
      .add_option("--on-data-error", s.on_data_error, "Fail on a corrupt or missing DEM file, or use the coarser layer")
      ->check(CLI::IsMember({"fail", "fall-through"}))
      ->capture_default_str();
  command
      .add_option("--blend-posts", s.blend_posts,
                  "Bend each layer towards a finer one in a band of this width, in posts of the coarser one; 0: none")
      ->check(number_in(0.0, 1000.0))
      ->capture_default_str();
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
  command
      .add_option("--take-as-heights", s.take_as_heights,
                  "Read rasters with that name (* and ? as in a shell) as heights in metres, regardless of their name, "
                  "description and values")
      ->type_name("PATTERN ...")
      ->expected(1, 1 << 20);
  command.add_flag(
      "--strict", s.strict,
      "Treat a file in a DEM folder that is not a DEM, such as an orthoimage, as an error instead of a warning");
  command.add_option("--log-level", s.log_level, "Log lines of at least this level")
      ->check(CLI::IsMember({"debug", "info", "warning", "error"}))
      ->capture_default_str();
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
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 30))
      ->capture_default_str();
  command.add_option("--max-image-side", s.max_image_side, "Limit the pixels of a frame's side")
      ->check(CLI::Range(1, 65535))
      ->capture_default_str();
  command.add_option("--max-map-pixels", s.max_map_pixels, "Limit the pixels of a map")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 30))
      ->capture_default_str();
  command.add_option("--max-samples-per-pixel", s.max_samples_per_pixel, "Limit the samples per pixel of a frame")
      ->check(CLI::Range(1, 65536))
      ->capture_default_str();
  command.add_option("--max-rays", s.max_rays, "Limit the rays or points of a request, and the craters of an answer")
      ->check(CLI::Range(1, 1 << 24))
      ->capture_default_str();
  command
      .add_option("--max-lidar-rays", s.max_lidar_rays, "Limit the sub-rays of a lidar's scan: beams times sub_rays")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 32))
      ->capture_default_str();
  command.add_option("--max-json-depth", s.max_json_depth, "Limit the nesting depth of a request")
      ->check(CLI::Range(4, 256))
      ->capture_default_str();
}

void add_options(CLI::App& command, ServeSettings& s) {
  add_options(command, s.terrain);
  add_options(command, s.limits);
  command.add_option("--host", s.host, "Listen on this address; put a proxy in front of anything but loopback")
      ->capture_default_str();
  command.add_option("--port", s.port, "Listen on this port; 0: any free one, which is printed")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  command
      .add_option("--memory-mb", s.terrain.memory.memory_mb,
                  "Limit all memory, MiB: --cache-mb, --scene-mb, --mesh-mb, active requests, bodies and answers. "
                  "0: three quarters of the machine's memory, at most 8192")
      ->check(CLI::Range(0, 1 << 24))
      ->capture_default_str();
  command.add_option("--max-frames", s.max_frames, "Process this many requests at once; 0: number of cores")
      ->check(CLI::Range(0, 4096))
      ->capture_default_str();
  command
      .add_option("--max-waiting", s.max_waiting,
                  "Let this many requests wait in the queue; one client alone may fill half of it")
      ->check(CLI::Range(0, 65536))
      ->capture_default_str();
  command
      .add_option("--max-connections", s.max_connections,
                  "Limit the connections; beyond the limit, close the one that has been idle longest")
      ->check(CLI::Range(4, 65536))
      ->capture_default_str();
  command.add_option("--idle-timeout-s", s.idle_timeout_s, "Limit the time of an idle connection")
      ->check(number_in(0.1, 86400.0))
      ->capture_default_str();
  command.add_option("--receive-timeout-s", s.receive_timeout_s, "Limit the time for receiving a request")
      ->check(number_in(0.1, 86400.0))
      ->capture_default_str();
  command
      .add_option("--send-kb-per-s", s.send_kb_per_s,
                  "Cut clients that read an answer at less than this rate, KiB/s, after ten seconds")
      ->check(number_in(1.0, 1e6))
      ->capture_default_str();
  command.add_option("--shutdown-s", s.shutdown_s, "Limit the time from SIGTERM to the end of the process")
      ->check(number_in(0.1, 86400.0))
      ->capture_default_str();
  command
      .add_option("--drain-s", s.drain_s,
                  "Accept requests for this part of --shutdown-s, while /health/ready tells a proxy to send them "
                  "elsewhere")
      ->check(number_in(0.0, 86400.0))
      ->capture_default_str();
  add_access(command, s);
  command.add_flag(
      "--pretouch", s.pretouch,
      "Touch the memory of --cache-mb and --scene-mb at the start, so that no frame waits for the system to "
      "provide it");
  command.add_flag("--trial", s.trial, "Start, send trial requests, stop");
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

void complete_from_environment_and_file(CLI::App& command, const std::set<std::string>& all_options,
                                        const ReadVariable& variable) {
  const std::string path = config_path(command, variable);
  const Values file = path.empty() ? Values{} : read_file(path, all_options);
  for (CLI::Option* option : command.get_options()) {
    const std::string name = long_name(*option);
    if (name.empty() || kNotSettings.count(name) || option->count() > 0) continue;
    const std::string environment_name = variable_name(name);
    if (const auto value = variable(environment_name)) {
      set_option(*option, is_list(*option) ? split_list(*value) : std::vector{*value}, environment_name);
    } else if (const auto found = file.find(name); found != file.end()) {
      set_option(*option, found->second, path + ": " + name);
    }
  }
}

}  // namespace selenograph::server
