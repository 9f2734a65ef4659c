// `selenograph map`: writes the bytes that POST /v1/maps answers, or a series of them over time.
#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <limits>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "api/answers/eclipse.h"
#include "api/answers/map_answer.h"
#include "api/answers/metadata.h"
#include "api/answers/metadata_members.h"
#include "api/message/problem.h"
#include "api/message/version.h"
#include "api/requests/parts/epochs.h"
#include "engine/maps/render_map.h"
#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/request_file.h"
#include "server/commands/start.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;
using api::Epoch;
using api::utc_of;

// Extensions of api::kMapAnswers, in the same order.
constexpr std::string_view kExtensions[] = {".tif", ".npz", ".png"};

// Returns the media type of a file's extension. Throws std::runtime_error for another one.
std::string_view media_type_for(const std::string& output) {
  std::string extension = fs::path(output).extension().string();
  if (extension == ".tiff") extension = ".tif";
  for (std::size_t i = 0; i < std::size(kExtensions); ++i)
    if (extension == kExtensions[i]) return api::kMapAnswers[i].media_type;
  throw std::runtime_error(output + ": the name must end in one of .tif, .npz, .png");
}

// --- times of a series, without leap seconds

std::string text_of(Epoch epoch, const char* format) {
  return fmt::format(fmt::runtime(format), fmt::gmtime(std::chrono::system_clock::to_time_t(epoch)));
}
// Parses an epoch of --utc. Throws std::runtime_error.
Epoch epoch_of(const std::string& text) {
  if (const auto epoch = api::epoch_of(text)) return *epoch;
  throw std::runtime_error("--utc: \"" + text + "\" is not an epoch like 2026-11-20T00:00:00Z, in whole seconds");
}

// Parses "30m": a whole number above 0 and a unit, together at most 36600 days.
std::chrono::seconds step_of(const std::string& text) {
  constexpr std::pair<std::string_view, std::int64_t> kUnits[] = {
      {"s", 1}, {"m", 60}, {"min", 60}, {"h", 3600}, {"d", 86400}};
  std::int64_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  const std::string_view unit(end, static_cast<std::size_t>(text.data() + text.size() - end));
  for (const auto& [name, seconds] : kUnits)
    if (error == std::errc() && unit == name && number > 0 && number <= 36600 * (86400 / seconds))
      return std::chrono::seconds(number * seconds);
  throw std::runtime_error("--utc: \"" + text + "\" is not a step like 600s, 30m, 6h or 1d");
}

// Returns the epochs FROM, FROM + STEP, .. up to TO; none without --utc.
std::vector<Epoch> epochs_of(const std::vector<std::string>& utc) {
  if (utc.empty()) return {};
  const Epoch from = epoch_of(utc[0]), to = epoch_of(utc[1]);
  const std::chrono::seconds step = step_of(utc[2]);
  if (to < from) throw std::runtime_error("--utc: " + utc[1] + " is before " + utc[0]);
  constexpr std::int64_t kMaxEpochs = 1000000;
  if ((to - from) / step >= kMaxEpochs) throw std::runtime_error(fmt::format("--utc: more than {} epochs", kMaxEpochs));
  std::vector<Epoch> epochs;
  for (Epoch epoch = from; epoch <= to; epoch += step) epochs.push_back(epoch);
  return epochs;
}

// Returns "site-20261120T000000Z.tif" for "site.tif" and "20261120T000000Z".
std::string with_name(const std::string& output, const std::string& name, const std::string& extension) {
  const fs::path path(output);
  return (path.parent_path() / (path.stem().string() + "-" + name + extension)).string();
}

// --- maps

// Returns the request with the Sun at an epoch. Throws RequestError if the request positions the Sun itself.
api::Json at_epoch(api::Json body, Epoch epoch) {
  if (!body.is_object()) return body;  // read_map() refuses it
  api::Json& sun = body["sun"];
  if (sun.is_null()) sun = api::Json::object();
  if (!sun.is_object()) return body;
  for (const char* member : {"direction", "subsolar", "local", "et_s"})
    if (sun.contains(member)) {
      const std::string why = std::string("cannot be combined with --utc, which sets the Sun's position");
      throw api::RequestError("invalid_request", why, {{std::string("/sun/") + member, why}});
    }
  sun["utc"] = utc_of(epoch);
  return body;
}

// A map and its request as read.
struct DrawnMap {
  api::MapQuery query;
  engine::Map map;
};

// Everything that the maps of a series have in common.
struct Atlas {
  const MapSettings& settings;
  const std::string& request;  // as JSON
  const engine::Renderer& renderer;
  const api::Assets& assets;
  const api::Limits& limits;
  std::string_view media_type;
  ProgressBar& bar;

  // Reads the request at an epoch or, if null, at its own.
  api::MapQuery query(const Epoch* epoch) const {
    api::Json body = api::parse_json(request);
    if (epoch) body = at_epoch(std::move(body), *epoch);
    api::MapQuery query = api::read_map(body, limits, assets);
    api::check_map_answer(query, media_type);
    return query;
  }

  // Returns true if the request is valid at an epoch; else prints its problem.
  bool is_valid_at(const Epoch& epoch) const {
    const api::Response answer = api::answer_or_problem({}, [&] {
      query(&epoch);
      return api::Response{};
    });
    if (answer.status != 200) print_problem(answer);
    return answer.status == 200;
  }

  // Writes one map at an epoch or, if null, at the request's own. `extra`: products to compute in addition to those of
  // the file. `number`, from 0, and `count` place the map in its series, for the progress bar. Prints the problem of an
  // invalid request and returns nothing.
  std::optional<DrawnMap> write(const std::string& path, const Epoch* epoch, engine::ProductSet extra,
                                std::size_t number, std::size_t count) const {
    std::optional<DrawnMap> drawn;
    const api::Response answer = api::answer_or_problem({}, [&] {
      api::MapQuery query = this->query(epoch);
      engine::MapRequest map_request = query.request;
      map_request.products |= extra;
      const auto show_progress = [&](double share) {
        bar.show((static_cast<double>(number) + share) / static_cast<double>(count), path);
      };
      engine::Map map = renderer.query(map_request.scenery.detail, {}, [&](const engine::RenderContext& rendering) {
        return engine::render_map(map_request, rendering, show_progress);
      });
      const std::string hash =
          api::content_hash(query, renderer.scene_bytes(), renderer.terrain().catalogue().fingerprint(), media_type);
      api::Response encoded;
      encoded.body = api::encode_map(query, map, hash, media_type);
      drawn.emplace(DrawnMap{std::move(query), std::move(map)});
      return encoded;
    });
    if (answer.status != 200) {
      print_problem(answer);
      return std::nullopt;
    }
    write_whole(path, answer.body);
    return drawn;
  }
};

// Adds a map's lit fractions to the sum over the series.
void add_lit(const std::vector<float>& lit, std::vector<double>& sum) {
  sum.resize(lit.size());
  for (std::size_t i = 0; i < lit.size(); ++i) sum[i] += static_cast<double>(lit[i]);  // NaN (no data) stays NaN
}

// Writes the mean of `lit` over the epochs as GeoTIFF. `sum`: of `lit`, per pixel. `last_query`: that of the last
// epoch.
void write_illumination(const api::MapQuery& last_query, const std::vector<double>& sum,
                        const std::vector<Epoch>& epochs, const MapSettings& settings, const std::string& path) {
  std::vector<float> fraction(sum.size());
  std::transform(sum.begin(), sum.end(), fraction.begin(),
                 [&](double total) { return static_cast<float>(total / static_cast<double>(epochs.size())); });
  const nlohmann::ordered_json meta{{"software", {{"name", "selenograph"}, {"version", api::software_version()}}},
                                    {"what", "mean of `lit` over the epochs"},
                                    {"from", utc_of(epochs.front())},
                                    {"to", utc_of(epochs.back())},
                                    {"step_s", step_of(settings.utc[2]).count()},
                                    {"epochs", epochs.size()},
                                    {"last_request", api::resolved_json(last_query)}};
  write_whole(path, api::encode_illumination(last_query, fraction, meta));
}

constexpr const char* kNoData = "of the pixels has no data: NaN, 65535 in source, 0 in a PNG";

std::vector<std::string> warnings_of(const DrawnMap& drawn) {
  nlohmann::ordered_json eclipse_warnings = nlohmann::ordered_json::array();
  api::warn_of_eclipse(api::sun_covered(drawn.query), api::kSunCovered, eclipse_warnings);
  std::vector<std::string> out = drawn.map.report.warnings;
  out.insert(out.end(), eclipse_warnings.begin(), eclipse_warnings.end());
  return out;
}

// Both draw functions return true if all maps have been written.
bool draw_series(const Atlas& atlas, const std::vector<Epoch>& epochs) {
  // Invalid epochs are before or after all valid ones, so that the first and the last decide if the series can finish.
  if (!atlas.is_valid_at(epochs.front()) || !atlas.is_valid_at(epochs.back())) return false;
  std::vector<double> sum;
  std::optional<api::MapQuery> last;
  std::map<std::string, std::size_t> warnings;  // number of maps with each
  std::size_t incomplete = 0;
  double missing_fraction = 0;
  const std::string extension = fs::path(atlas.settings.output).extension().string();
  for (std::size_t i = 0; i < epochs.size(); ++i) {
    const std::string name = text_of(epochs[i], "{:%Y%m%dT%H%M%SZ}");
    const std::string path = with_name(atlas.settings.output, name, extension);
    std::optional<DrawnMap> drawn = atlas.write(path, &epochs[i], engine::kLit, i, epochs.size());
    if (!drawn) return false;
    add_lit(drawn->map.products.lit, sum);
    const engine::FrameReport& report = drawn->map.report;
    incomplete += report.missing_fraction > 0;
    missing_fraction = std::max(missing_fraction, report.missing_fraction);
    for (const std::string& warning : warnings_of(*drawn)) ++warnings[warning];
    last = std::move(drawn->query);
  }
  const std::string path = with_name(atlas.settings.output, "illumination", ".tif");
  write_illumination(*last, sum, epochs, atlas.settings, path);
  fmt::print("{} maps, and {}: the mean of lit over them\n", epochs.size(), path);
  if (incomplete > 0) fmt::print("of {} maps a share of up to {:.6g} {}\n", incomplete, missing_fraction, kNoData);
  for (const auto& [text, maps] : warnings) fmt::print("warning, of {} maps: {}\n", maps, text);
  return true;
}

bool draw_one(const Atlas& atlas) {
  const std::optional<DrawnMap> drawn = atlas.write(atlas.settings.output, nullptr, 0, 0, 1);
  if (!drawn) return false;
  const dem::MapGrid& grid = drawn->query.request.grid;
  const engine::FrameReport& report = drawn->map.report;
  std::FILE* messages = stream_for_messages(atlas.settings.output);
  fmt::print(messages, "{}: {} x {} pixels of {:g} m\n", atlas.settings.output, grid.width, grid.height, grid.gsd_m);
  if (report.missing_fraction > 0)
    fmt::print(messages, "{}: a share of {:.6g} {}\n", atlas.settings.output, report.missing_fraction, kNoData);
  for (const std::string& warning : warnings_of(*drawn)) fmt::print(messages, "warning: {}\n", warning);
  return true;
}

}  // namespace

int map(const MapSettings& settings) {
  set_up_log(settings.terrain.log_level);
  const std::string_view media_type = media_type_for(settings.output);
  const std::vector<Epoch> epochs = epochs_of(settings.utc);
  const std::string text = read_request(settings.request);
  const api::Limits limits = command_limits();
  const api::Assets assets(settings.terrain.assets_dir, mesh_options(settings.terrain));
  const auto renderer = make_renderer(settings.terrain);
  ProgressBar bar;
  const Atlas atlas{settings, text, *renderer, assets, limits, media_type, bar};
  return (epochs.empty() ? draw_one(atlas) : draw_series(atlas, epochs)) ? 0 : 1;
}

}  // namespace selenograph::server
