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

const std::set<std::string> kNotSettings{"help", "version", "config"};

std::string scalar_text(const toml::node& node, const std::string& where) {
  if (const auto* text = node.as_string()) return text->get();
  if (const auto* number = node.as_integer()) return std::to_string(number->get());
  if (const auto* truth = node.as_boolean()) return truth->get() ? "true" : "false";
  if (const auto* number = node.as_floating_point()) {
    std::ostringstream text;
    text.precision(17);
    text << number->get();
    return text.str();
  }
  throw CLI::ValidationError(where, "must be a string, a number, true, false, or a list of these");
}

Values read_file(const std::string& path, const std::set<std::string>& known) {
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
    if (!known.count(name)) throw CLI::ValidationError(where, "is not an option of any command");
    if (const toml::array* list = node.as_array()) {
      values[name];
      for (const toml::node& item : *list) values[name].push_back(scalar_text(item, where));
    } else {
      values[name] = {scalar_text(node, where)};
    }
  }
  return values;
}

bool is_list(const CLI::Option& option) { return option.get_items_expected_max() > 1; }

// Whether a colon of this list is part of a URL: before "//", or before the port.
bool is_of_url(const std::string& text, std::size_t from, std::size_t colon) {
  if (text.compare(colon + 1, 2, "//") == 0) return true;
  const std::size_t host = text.rfind("://", colon);
  return host != std::string::npos && host >= from && text.find('/', host + 3) > colon && colon + 1 < text.size() &&
         std::isdigit(static_cast<unsigned char>(text[colon + 1]));
}

// Whether a colon of this list is part of an address: "[fd00::1]".
bool is_bracketed(const std::string& text, std::size_t from, std::size_t colon) {
  return text[from] == '[' && text.find(']', from) != std::string::npos && text.find(']', from) > colon;
}

// At colons, as PATH is.
std::vector<std::string> split_list(const std::string& text) {
  std::vector<std::string> parts;
  for (std::size_t from = 0; from < text.size();) {
    std::size_t colon = text.find(':', from);
    while (colon != std::string::npos && (is_of_url(text, from, colon) || is_bracketed(text, from, colon)))
      colon = text.find(':', colon + 1);
    const std::size_t end = std::min(colon, text.size());
    if (end > from) parts.push_back(text.substr(from, end - from));
    from = end + 1;
  }
  return parts;
}

// CLI11 says "not in range" of what is not a number, too.
std::string complaint(const CLI::Option& option, const std::string& value, const CLI::ParseError& error) {
  const std::string type = option.get_type_name();
  const bool whole = type.find("INT") != std::string::npos;
  if (!whole && type.find("FLOAT") == std::string::npos) return error.what();
  double number = 0;
  if (!CLI::detail::lexical_cast(value, number)) return value + " is not a number";
  return whole && number != std::floor(number) ? value + " is not a whole number" : error.what();
}

void set_option(CLI::Option& option, const std::vector<std::string>& values, const std::string& origin) {
  if (values.size() != 1 && !is_list(option)) throw CLI::ValidationError(origin, "takes one value");
  if (values.empty()) return;
  try {
    option.add_result(values);
    option.run_callback();
  } catch (const CLI::ParseError& e) {
    throw CLI::ValidationError(origin, complaint(option, values.front(), e));
  }
}

std::string long_name(const CLI::Option& option) {
  return option.get_lnames().empty() ? std::string() : option.get_lnames().front();
}

std::string config_path(CLI::App& command, const ReadVariable& variable) {
  const CLI::Option* option = command.get_option_no_throw("--config");
  if (!option) return {};
  if (option->count() > 0) return option->as<std::string>();
  return variable("SELENOGRAPH_CONFIG").value_or("");
}

void add_files_and_memory(CLI::App& command, TerrainSettings& s) {
  const std::string by_default = "; default: 1024, or less if that does not fit";
  s.cache_dir = default_cache_dir();
  command.add_option("--config", "TOML file whose members are these options, e.g. cache-mb = 2048")->type_name("FILE");
  command.add_option("--dem", s.dem, "DEM files and folders; default: sample terrain")
      ->type_name("PATH ...")
      ->expected(1, 1 << 20);
  command
      .add_option("--assets-dir", s.assets_dir,
                  "Folder of files that requests refer to by name: see deploy/assets/README.md")
      ->type_name("DIR")
      ->check(CLI::ExistingDirectory);
  command
      .add_option(
          "--remote-prefix", s.remote_prefix,
          "Remote DEMs: read what has this name or lies below it, e.g. /vsicurl/https://example.org/dem/; default: "
          "local files only")
      ->each([&s](const std::string&) { s.memory.remote_tiles = true; })
      ->type_name("PREFIX ...")
      ->expected(1, 1 << 20);
  command
      .add_option("--mesh-mb", s.memory.mesh_mb,
                  "Memory for reading one object mesh, and for cached meshes, star catalogues and other assets, MiB" +
                      by_default)
      ->check(CLI::Range(16, 1 << 24));
  command.add_option("--mesh-s", s.mesh_s, "Time limit for reading one mesh")
      ->check(number_in(0.1, 86400.0))
      ->capture_default_str();
  command.add_option("--cache-dir", s.cache_dir, "Folder for pyramids")->type_name("DIR")->capture_default_str();
  command
      .add_option(
          "--ground-disk-mb", s.ground_disk_mb,
          "Disk space for ground with detail in the cache folder, MiB, reused by later and other processes. 0: none")
      ->check(CLI::Range(0, 1 << 24))
      ->capture_default_str();
  command.add_option("--cache-mb", s.memory.cache_mb, "Memory for terrain, MiB" + by_default)
      ->check(CLI::Range(16, 1 << 24));
  command
      .add_option("--scene-mb", s.memory.scene_mb,
                  "Memory for acceleration structures and rendering buffers, MiB" + by_default)
      ->check(CLI::Range(16, 1 << 24));
}

// Empty: it can be parsed.
std::string refusal_of(const std::string& text, dem::NamedNumber (*parse)(const std::string&)) {
  try {
    parse(text);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return {};
}

std::string refusal_of_address(const std::string& text) {
  in6_addr address{};
  const bool numeric =
      ::inet_pton(AF_INET, text.c_str(), &address) == 1 || ::inet_pton(AF_INET6, text.c_str(), &address) == 1;
  return numeric ? std::string() : text + " is not an IP address";
}

std::string refusal_of_host(const std::string& text) {
  return is_host(text) ? std::string() : text + " is not a host name or address (without scheme and port)";
}

// Access to the service and its pages; the log.
void add_access(CLI::App& command, ServeSettings& s) {
  const std::map<std::string, PageAccess> access{
      {"off", PageAccess::off}, {"local", PageAccess::local}, {"on", PageAccess::on}};
  command.add_option("--page", s.page, "Who may open the pages / and /docs: nobody, this machine, everybody")
      ->transform(CLI::CheckedTransformer(access).description("{off,local,on}"))
      ->default_str("local");
  const std::map<std::string, LogFormat> formats{{"text", LogFormat::text}, {"json", LogFormat::json}};
  command
      .add_option(
          "--log-format", s.log_format,
          "Format of the log on stderr; json: one object per line, for requests with id, token, times and bytes")
      ->transform(CLI::CheckedTransformer(formats).description("{text,json}"))
      ->default_str("text");
  command
      .add_option("--trusted-proxy", s.trusted_proxy,
                  "Address of a proxy that sets or removes the header Selenograph-Token, besides loopback")
      ->type_name("ADDRESS ...")
      ->check(refusal_of_address)
      ->expected(1, 1 << 20);
  command
      .add_option("--allowed-host", s.allowed_host,
                  "Name or address that clients may use for the service, and whose pages may call it, besides --host, "
                  "localhost, 127.0.0.1, [::1] and the address to which a connection is made")
      ->type_name("NAME ...")
      ->check(refusal_of_host)
      ->expected(1, 1 << 20);
}

}  // namespace

void add_options(CLI::App& command, TerrainSettings& s) {
  add_files_and_memory(command, s);
  command.add_option("--threads", s.threads, "Render threads; 0: all cores")
      ->check(CLI::Range(0, 4096))
      ->capture_default_str();
  command
      .add_option("--on-data-error", s.on_data_error,
                  "On a corrupt or missing DEM file: fail, or use the coarser layer")
      ->check(CLI::IsMember({"fail", "fall-through"}))
      ->capture_default_str();
  command
      .add_option("--blend-posts", s.blend_posts,
                  "Width of the band in which a layer is bent to meet a finer one, in posts of the coarser "
                  "one; 0: none")
      ->check(number_in(0.0, 1000.0))
      ->capture_default_str();
  command
      .add_option("--layer-offset", s.layer_offset,
                  "Offset added to the heights of files with that name (* and ? as in a shell), m; fit: measured "
                  "against the coarser layer along the border")
      ->type_name("PATTERN=METRES|fit ...")
      ->expected(1, 1 << 20)
      ->check([](const std::string& text) { return refusal_of(text, dem::parse_layer_offset); });
  command
      .add_option("--resolved-posts", s.resolved_posts,
                  "Resolution of files with that name, in posts: detail begins there; fit: measured from the heights")
      ->type_name("PATTERN=POSTS|fit ...")
      ->expected(1, 1 << 20)
      ->check([](const std::string& text) { return refusal_of(text, dem::parse_resolved_posts); });
  command
      .add_option("--take-as-heights", s.take_as_heights,
                  "Rasters with that name (* and ? as in a shell) are heights in metres, whatever their name, "
                  "description and values say")
      ->type_name("PATTERN ...")
      ->expected(1, 1 << 20);
  command.add_flag("--strict", s.strict,
                   "A file in a DEM folder that is not a DEM, such as an orthoimage, is an error instead of a warning");
  command.add_option("--log-level", s.log_level, "Minimum level of log lines")
      ->check(CLI::IsMember({"debug", "info", "warning", "error"}))
      ->capture_default_str();
}

void add_options(CLI::App& command, api::Limits& s) {
  const std::chrono::duration<double> deadline = s.default_deadline;
  command
      .add_option_function<double>(
          "--deadline-s", [&s](double seconds) { s.default_deadline = milliseconds(seconds); },
          "Time limit of one request; clients can ask for less")
      ->check(number_in(0.001, 86400.0))
      ->default_str(fmt::format("{:g}", deadline.count()));
  command
      .add_option_function<std::size_t>(
          "--max-body-kb", [&s](std::size_t kib) { s.max_body_bytes = kib << 10; },
          "Maximum size of a request body, KiB")
      ->check(CLI::Range(1, 1 << 20))
      ->default_str(std::to_string(s.max_body_bytes >> 10));
  command.add_option("--max-image-pixels", s.max_image_pixels, "Maximum pixels of a frame")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 30))
      ->capture_default_str();
  command.add_option("--max-image-side", s.max_image_side, "Maximum pixels of a frame's side")
      ->check(CLI::Range(1, 65535))
      ->capture_default_str();
  command.add_option("--max-map-pixels", s.max_map_pixels, "Maximum pixels of a map")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 30))
      ->capture_default_str();
  command.add_option("--max-samples-per-pixel", s.max_samples_per_pixel, "Maximum samples per pixel of a frame")
      ->check(CLI::Range(1, 65536))
      ->capture_default_str();
  command.add_option("--max-rays", s.max_rays, "Maximum rays or points of a request, and craters of an answer")
      ->check(CLI::Range(1, 1 << 24))
      ->capture_default_str();
  command.add_option("--max-lidar-rays", s.max_lidar_rays, "Maximum sub-rays of a lidar's scan: beams times sub_rays")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 32))
      ->capture_default_str();
  command.add_option("--max-json-depth", s.max_json_depth, "Maximum nesting depth of a request")
      ->check(CLI::Range(4, 256))
      ->capture_default_str();
}

void add_options(CLI::App& command, ServeSettings& s) {
  add_options(command, s.terrain);
  add_options(command, s.limits);
  command.add_option("--host", s.host, "Address to listen on; put a proxy in front of anything but loopback")
      ->capture_default_str();
  command.add_option("--port", s.port, "Port; 0: any free one, which is printed")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  command
      .add_option("--memory-mb", s.terrain.memory.memory_mb,
                  "Memory for everything, MiB: --cache-mb, --scene-mb, --mesh-mb, active requests, bodies and answers. "
                  "0: three quarters of the machine's memory, at most 8192")
      ->check(CLI::Range(0, 1 << 24))
      ->capture_default_str();
  command.add_option("--max-frames", s.max_frames, "Requests processed at once; 0: number of cores")
      ->check(CLI::Range(0, 4096))
      ->capture_default_str();
  command
      .add_option("--max-waiting", s.max_waiting,
                  "Requests that may wait in the queue; one client alone may fill half of it")
      ->check(CLI::Range(0, 65536))
      ->capture_default_str();
  command
      .add_option("--max-connections", s.max_connections,
                  "Maximum connections; beyond it, the one that has been idle longest is closed")
      ->check(CLI::Range(4, 65536))
      ->capture_default_str();
  command.add_option("--idle-timeout-s", s.idle_timeout_s, "Time limit of an idle connection")
      ->check(number_in(0.1, 86400.0))
      ->capture_default_str();
  command.add_option("--receive-timeout-s", s.receive_timeout_s, "Time limit for receiving a whole request")
      ->check(number_in(0.1, 86400.0))
      ->capture_default_str();
  command
      .add_option("--send-kb-per-s", s.send_kb_per_s,
                  "Minimum rate at which a client must read an answer, KiB/s, after ten seconds")
      ->check(number_in(1.0, 1e6))
      ->capture_default_str();
  command.add_option("--shutdown-s", s.shutdown_s, "Time limit from SIGTERM to the end of the process")
      ->check(number_in(0.1, 86400.0))
      ->capture_default_str();
  command
      .add_option("--drain-s", s.drain_s,
                  "Part of --shutdown-s in which requests are still accepted while /health/ready tells a proxy to send "
                  "them elsewhere")
      ->check(number_in(0.0, 86400.0))
      ->capture_default_str();
  add_access(command, s);
  command.add_flag("--pretouch", s.pretouch,
                   "Take the memory of --cache-mb and --scene-mb from the system at the start, so that no frame waits "
                   "for it");
  command.add_flag("--trial", s.trial, "Start, check, quit");
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

void complete_from_environment_and_file(CLI::App& command, const std::set<std::string>& known,
                                        const ReadVariable& variable) {
  const std::string path = config_path(command, variable);
  const Values file = path.empty() ? Values{} : read_file(path, known);
  for (CLI::Option* option : command.get_options()) {
    const std::string name = long_name(*option);
    if (name.empty() || kNotSettings.count(name) || option->count() > 0) continue;
    const std::string variable_of = variable_name(name);
    if (const auto value = variable(variable_of)) {
      set_option(*option, is_list(*option) ? split_list(*value) : std::vector{*value}, variable_of);
    } else if (const auto found = file.find(name); found != file.end()) {
      set_option(*option, found->second, path + ": " + name);
    }
  }
}

}  // namespace selenograph::server
