#include "api/assets/assets.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <filesystem>
#include <limits>
#include <stdexcept>
#include <utility>

#include "api/assets/sight_file.h"
#include "api/json/ranges.h"
#include "api/message/problem.h"
#include "dem/base/error.h"
#include "dem/base/hash.h"
#include "dem/base/names.h"
#include "dem/files/files.h"
#include "engine/support/csv.h"
#include "engine/visibility/meshes/mesh_reader.h"

namespace selenograph::api {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxAssetDepth = 16;  // nesting of JSON
constexpr int kMaxBands = 1000;     // of a map's raster
constexpr Range kExponent{0.1, 10};
constexpr auto kFailureLifetime = std::chrono::minutes(1);  // time for which an unusable file is not read again
constexpr std::size_t kMaxFailures = 1000;

// Returns true for a name that cannot lead out of the folder: names come from clients.
bool is_plain(std::string_view name) {
  return name.size() <= 100 && dem::consists_of(name, "-_.") && name.front() != '.';
}

// Returns the JSON object in a file. Throws DataError naming the file.
Json read_object_file(const std::string& path) {
  const std::string text = dem::read_head(path, std::numeric_limits<std::size_t>::max());
  try {
    Json json = parse_json(text, kMaxAssetDepth);
    if (!json.is_object()) throw DataError(path, "must be a JSON object");
    return json;
  } catch (const RequestError& e) {
    throw DataError(path, e.what());
  }
}

// Throws DataError with the file's path for the first fault: it is the operator's, not the client's.
void throw_if_faulty(const std::string& path, const Findings& findings) {
  if (findings.empty()) return;
  const Finding& first = findings.entries().front();
  throw DataError(path, fmt::format("{}: {}", first.pointer, first.detail));
}

dem::Footprint read_extent(const JsonReader& in) {
  dem::Footprint f;
  if (!in.object({"south_deg", "north_deg", "west_deg", "east_deg"})) return f;
  f = {in.number("south_deg", kLatitude_deg), in.number("north_deg", kLatitude_deg),
       in.number("west_deg", kLongitude_deg), in.number("east_deg", kLongitude_deg)};
  if (!in.good()) return f;
  if (!(f.south_deg < f.north_deg)) in.fail("south_deg", "must be below north_deg");
  if (!(f.west_deg < f.east_deg && f.east_deg <= f.west_deg + 360))
    in.fail("west_deg", "must be below east_deg, by 360 at most");
  return f;
}

}  // namespace

std::optional<Assets::FileVersion> Assets::find_file(const char* kind, const char* extension,
                                                     std::string_view name) const {
  if (folder_.empty() || !is_plain(name)) return std::nullopt;
  const fs::path path = fs::path(folder_) / kind / (std::string(name) + extension);
  std::optional<dem::FileState> state = dem::file_state(path.string());
  if (!state) return std::nullopt;
  return FileVersion{path.string(), *state};
}

std::string Assets::FileVersion::key(const char* type) const {
  return fmt::format("{}:{}:{:016x}", type, path, dem::stamp_of(state));
}

template <typename T, typename Read, typename BytesOf>
std::shared_ptr<const T> Assets::find(const char* type, const FileVersion& file, const StopToken& stop,
                                      const Read& read, const BytesOf& bytes_of) const {
  // A changed file has another key; the content under the old key is evicted in time.
  const std::string key = file.key(type);
  throw_if_failed(key);
  try {
    const auto load = [&] {
      auto content = std::make_shared<const ContentOf<T>>([&] { return read(file.path); });
      const std::size_t bytes = bytes_of(content->value);
      return Files::Loaded{std::move(content), bytes};
    };
    const auto content = std::static_pointer_cast<const ContentOf<T>>(files_.get(key, load, stop));
    return {content, &content->value};  // points to the value and shares ownership of the cache's entry
  } catch (const DataError& e) {
    // Do not remember an error of another file, such as a map's raster: it may be mended without a change of this file.
    if (e.file() == file.path) remember_failure(key, e.what());
    throw RequestError("asset_error", e.what());
  }
}

template <typename T, typename Read>
std::shared_ptr<const T> Assets::find_small(const char* type, const std::optional<FileVersion>& file,
                                            const StopToken& stop, const Read& read) const {
  // Upper bound of memory per byte of the file, as JSON or as rows of numbers.
  constexpr std::size_t kBytesPerFileByte = 64;
  if (!file) return nullptr;
  const std::size_t bytes = kBytesPerFileByte * file->state.bytes;
  const auto read_if_small = [&](const std::string& path) {
    if (bytes > files_.capacity())
      throw DataError(path, fmt::format("has {} bytes, at most {} are read; --mesh-mb allows more", file->state.bytes,
                                        files_.capacity() / kBytesPerFileByte));
    return read(path);
  };
  return find<T>(type, *file, stop, read_if_small, [&](const T&) { return bytes; });
}

std::shared_ptr<const engine::Atmosphere> Assets::atmosphere(std::string_view name, const StopToken& stop) const {
  return find_small<engine::Atmosphere>("atmosphere", find_file("atmospheres", ".csv", name), stop,
                                        engine::Atmosphere::read);
}

std::shared_ptr<const Json> Assets::camera(std::string_view name, const StopToken& stop) const {
  return find_small<Json>("camera", find_file("cameras", ".json", name), stop, read_object_file);
}

std::shared_ptr<const Json> Assets::lidar(std::string_view name, const StopToken& stop) const {
  return find_small<Json>("lidar", find_file("lidars", ".json", name), stop, read_object_file);
}

std::shared_ptr<const Json> Assets::map_error(std::string_view name, const StopToken& stop) const {
  return find_small<Json>("map_error", find_file("map_errors", ".json", name), stop, read_object_file);
}

std::shared_ptr<const std::vector<std::vector<double>>> Assets::kernel(std::string_view name,
                                                                       const StopToken& stop) const {
  using Rows = std::vector<std::vector<double>>;
  return find_small<Rows>("kernel", find_file("kernels", ".csv", name), stop, [&](const std::string& path) {
    Rows rows;
    const auto add = [&](std::string_view line) { rows.push_back(engine::csv_numbers(line)); };
    engine::each_csv_line(path, add, stop);
    return rows;
  });
}

std::shared_ptr<const engine::StarCatalogue> Assets::stars(std::string_view name, const StopToken& stop) const {
  const auto file = find_file("stars", ".csv", name);
  if (!file) return nullptr;
  const auto read = [&](const std::string& path) {
    // Read one catalogue at a time, so that the memory for reading is needed only once.
    std::unique_lock lock(reading_stars_, std::defer_lock);
    while (!lock.try_lock_for(dem::kPollInterval)) stop.check();
    return engine::StarCatalogue::read(path, files_.capacity(), stop);
  };
  return find<engine::StarCatalogue>("stars", *file, stop, read,
                                     [](const engine::StarCatalogue& stars) { return stars.bytes(); });
}

std::shared_ptr<const dem::ValueMap> Assets::find_map(const char* type, std::string_view name, bool fourth_power,
                                                      const StopToken& stop) const {
  const auto file = find_file("maps", ".json", name);
  const auto find = [&] {
    return find_small<dem::ValueMap>(type, file, stop, [&](const std::string& path) {
      dem::ValueMapOptions options = read_map_file(path);
      options.fourth_power = fourth_power;
      return dem::ValueMap(options, map_tiles_);
    });
  };
  auto map = find();
  if (!map || map->current()) return map;
  files_.erase(file->key(type));  // the map's raster has changed
  return find();
}

std::shared_ptr<const dem::ValueMap> Assets::map(std::string_view name, const StopToken& stop) const {
  return find_map("map", name, false, stop);
}

std::shared_ptr<const dem::ValueMap> Assets::temperature_map(std::string_view name, const StopToken& stop) const {
  return find_map("temperature map", name, true, stop);
}

namespace {

// Reads "quantity": "radiance_factor" with the geometry and wavelength of its I/F; returns empty for maps of rho, w or
// kelvin.
std::optional<dem::RadianceFactor> read_quantity(const JsonReader& in) {
  constexpr std::array kRequiredMembers{"incidence_deg", "emission_deg", "phase_deg", "wavelength_um"};
  if (!in.has("quantity")) {
    for (const char* name : kRequiredMembers)
      if (in.has(name)) in.fail(name, "needs \"quantity\": \"radiance_factor\"");
    return std::nullopt;
  }
  const std::pair<std::string_view, std::monostate> words[] = {{"radiance_factor", {}}};
  if (!in.at("quantity").word(Words<std::monostate>(words))) return std::nullopt;
  constexpr Range kSlant = from(0).below(90);
  const dem::RadianceFactor geometry{in.number("incidence_deg", kSlant), in.number("emission_deg", kSlant),
                                     in.number("phase_deg", from(0).below(180)),
                                     in.number("wavelength_um", Range{0.1, 1000})};
  if (!in.good()) return std::nullopt;
  // The directions to the Sun, to the viewer and along the normal span a spherical triangle, whose sides are the three
  // angles: none is longer than the other two together.
  if (geometry.phase_deg > geometry.incidence_deg + geometry.emission_deg ||
      geometry.phase_deg < std::abs(geometry.incidence_deg - geometry.emission_deg))
    in.fail("phase_deg", "must lie between the difference and the sum of incidence and emission");
  return geometry;
}

}  // namespace

dem::ValueMapOptions read_map_file(const std::string& path) {
  const Json json = read_object_file(path);
  Findings findings;
  const JsonReader in(json, findings);
  dem::ValueMapOptions map;
  if (in.object({"file", "bands", "extent", "scale", "offset", "exponent", "no_data", "low", "high", "quantity",
                 "incidence_deg", "emission_deg", "phase_deg", "wavelength_um", "description"})) {
    if (!in.has("file")) in.fail("file", "is required");
    if (in.has("file")) map.path = (fs::path(path).parent_path() / in.at("file").text().value_or("")).string();
    if (in.has("bands"))
      in.at("bands").elements(1, kMaxBands, [&](const JsonReader& band) {
        map.bands.push_back(static_cast<int>(band.number(Range{1, kMaxBands}).value_or(1)));
      });
    if (in.has("extent")) map.extent = read_extent(in.at("extent"));
    map.scale = in.number("scale", kAnyNumber, map.scale);
    map.offset = in.number("offset", kAnyNumber, map.offset);
    map.exponent = in.number("exponent", kExponent, map.exponent);
    map.radiance_factor = read_quantity(in);
    if (in.has("no_data")) map.no_data = in.number("no_data", kAnyNumber);
    map.low = in.number("low", kAnyNumber, map.low);
    map.high = in.number("high", kAnyNumber, map.high);
    if (map.low > map.high) in.fail("low", "is above \"high\"");
    if (in.has("description")) in.at("description").text();
  }
  throw_if_faulty(path, findings);
  return map;
}

namespace {

constexpr Range kFeature_m{0.00390625, 5000};  // 2^-8 m is the smallest octave that the finest level shows

dem::SizeFrequency read_frequency(const JsonReader& in) {
  constexpr std::size_t kMaxLaws = 8;
  dem::SizeFrequency frequency;
  in.elements(1, kMaxLaws, [&](const JsonReader& law) {
    if (law.object({"per_m2", "exponent"}))
      frequency.laws.push_back({law.number("per_m2", above(0).to(10)), law.number("exponent", Range{0.5, 8})});
  });
  return frequency;
}

// Returns the first of the diameters smallest_m * 2^n above which `law` has more than `factor` times as many features
// as `reference`; empty if there is none below largest_m.
std::optional<double> find_denser_diameter(const dem::SizeFrequency& law, double factor,
                                           const dem::SizeFrequency& reference, double smallest_m, double largest_m) {
  double diameter_m = smallest_m;
  while (diameter_m < largest_m && law.above(diameter_m) <= factor * reference.above(diameter_m)) diameter_m *= 2;
  return diameter_m < largest_m ? std::optional(diameter_m) : std::nullopt;
}

void read_craters(const JsonReader& in, dem::CraterLaw& craters) {
  if (!in.object({"smallest_m", "largest_m", "frequency", "oldest_Ma"})) return;
  craters.smallest_m = in.number("smallest_m", kFeature_m);
  craters.largest_m = in.number("largest_m", kFeature_m);
  if (in.has("frequency")) craters.frequency = read_frequency(in.at("frequency"));
  craters.oldest_Ma = in.number("oldest_Ma", above(0).to(4500), craters.oldest_Ma);
  if (!in.good()) return;
  if (!(craters.smallest_m < craters.largest_m)) return in.fail("smallest_m", "must be below largest_m");
  // Limit the density to ten times equilibrium: no surface on the Moon is denser, and rendering time grows with it.
  const auto too_dense_m =
      find_denser_diameter(craters.frequency, 10, dem::equilibrium(), craters.smallest_m, craters.largest_m);
  if (too_dense_m)
    in.fail("frequency", fmt::format("has more than ten times equilibrium's craters above {:g} m", *too_dense_m));
}

void read_rocks(const JsonReader& in, dem::RockLaw& rocks) {
  if (!in.object({"smallest_m", "largest_m", "frequency", "on_ejecta", "half_life_Ma", "smallest_crater_m",
                  "smallest_fragment_m"}))
    return;
  constexpr Range kRock_m{0.02, 100};
  rocks.smallest_m = in.number("smallest_m", kRock_m);
  rocks.largest_m = in.number("largest_m", kRock_m);
  rocks.frequency = in.has("frequency") ? read_frequency(in.at("frequency")) : dem::rocks_of_viper();
  rocks.on_ejecta = in.number("on_ejecta", Range{1, 100}, rocks.on_ejecta);
  rocks.half_life_Ma = in.number("half_life_Ma", above(0).to(4500), rocks.half_life_Ma);
  rocks.smallest_crater_m = in.number("smallest_crater_m", kFeature_m, rocks.smallest_crater_m);
  if (in.has("smallest_fragment_m")) rocks.smallest_fragment_m = in.number("smallest_fragment_m", kFeature_m);
  if (!in.good()) return;
  if (!(rocks.smallest_m < rocks.largest_m)) return in.fail("smallest_m", "must be below largest_m");
  if (!(rocks.smallest_fragment_m < rocks.smallest_m))
    return in.fail("smallest_fragment_m", "must be below smallest_m");
  // Limit the density to ten times Haworth's, also on ejecta next to craters, where it is on_ejecta times as high.
  const auto find_too_dense_diameter = [&] {
    return find_denser_diameter(rocks.frequency, 10 / rocks.on_ejecta, dem::rocks_of_haworth(), rocks.smallest_m,
                                rocks.largest_m);
  };
  // Lower the default for ground as rocky as Haworth's, which is already covered by ejecta.
  if (!in.has("on_ejecta") && find_too_dense_diameter()) rocks.on_ejecta = 5;
  if (const auto too_dense_m = find_too_dense_diameter())
    in.fail("frequency", fmt::format("has, next to fresh craters, more than ten times the rocks above {:g} m that were "
                                     "counted in Haworth's rocky parts",
                                     *too_dense_m));
  if (rocks.smallest_fragment_m > 0 &&
      find_denser_diameter(rocks.frequency, 10, dem::rocks_of_haworth(), rocks.smallest_fragment_m, rocks.smallest_m))
    in.fail("frequency", "has more than ten times the fragments of a continuation of Haworth's rocky parts");
}

dem::Region read_region(const JsonReader& in) {
  constexpr std::size_t kMaxCorners = 256;
  std::vector<Geographic> corners;
  in.elements(3, kMaxCorners, [&](const JsonReader& corner) {
    if (const auto lat_lon = corner.pair(Range{-90, 90}, Range{-360, 360}))
      corners.push_back({lat_lon->first, lat_lon->second, 0});
  });
  if (!in.good()) return {};
  try {
    return dem::Region(corners);
  } catch (const std::invalid_argument& e) {
    in.fail(e.what());
    return {};
  }
}

void read_fine_relief(const JsonReader& in, dem::ReliefLaw::Fine& fine) {
  if (!in.object({"below_m", "hurst", "slope"})) return;
  fine.below_m = in.number("below_m", kFeature_m);
  fine.hurst = in.number("hurst", from(0.1).below(1), fine.hurst);
  fine.slope = in.number("slope", above(0).to(1));
}

void read_relief(const JsonReader& in, dem::ReliefLaw& relief) {
  if (!in.object({"hurst", "deviation_m", "baseline_m", "shortest_m", "longest_m", "fine", "min_factor"})) return;
  relief.hurst = in.number("hurst", from(0.1).below(1), relief.hurst);
  relief.deviation_m = in.number("deviation_m", above(0).to(1000));
  relief.baseline_m = in.number("baseline_m", Range{0.01, 1e5});
  relief.shortest_m = in.number("shortest_m", kFeature_m);
  relief.longest_m = in.number("longest_m", kFeature_m);
  relief.min_factor = in.number("min_factor", Range{0, 1}, relief.min_factor);
  if (in.has("fine")) read_fine_relief(in.at("fine"), relief.fine);
  if (in.good() && !(relief.shortest_m < relief.longest_m)) in.fail("shortest_m", "must be below longest_m");
}

void read_clods(const JsonReader& in, dem::ClodLaw& clods) {
  if (!in.object({"cover", "smallest_m", "largest_m"})) return;
  clods.cover = in.number("cover", above(0).to(0.3));
  constexpr Range kClod_m{kFeature_m.min, 1};
  clods.smallest_m = in.number("smallest_m", kClod_m);
  clods.largest_m = in.number("largest_m", kClod_m);
  if (in.good() && !(clods.smallest_m < clods.largest_m)) in.fail("smallest_m", "must be below largest_m");
}

dem::PublishedSlopes read_published(const JsonReader& in) {
  dem::PublishedSlopes slopes;
  if (!in.object({"median_slope_deg", "baseline_m", "hurst", "source"})) return slopes;
  slopes.median_slope_deg = in.number("median_slope_deg", above(0).to(45));
  slopes.baseline_m = in.number("baseline_m", Range{0.01, 1e5});
  slopes.hurst = in.number("hurst", from(0.1).below(1));
  in.at("source").text();
  return slopes;
}

std::vector<dem::LawSource> read_sources(const JsonReader& in) {
  std::vector<dem::LawSource> sources;
  if (!in.object({"craters", "relief", "clods", "rocks"})) return sources;
  for (const char* const law : {"craters", "relief", "clods", "rocks"}) {
    if (!in.has(law)) continue;
    const JsonReader source = in.at(law);
    if (!source.object({"measured", "extrapolated"})) continue;
    const auto text_of = [&](const char* member) { return source.at(member).text().value_or(""); };
    sources.push_back({law, text_of("measured"), text_of("extrapolated")});
  }
  return sources;
}

}  // namespace

std::shared_ptr<const dem::Detail> Assets::detail(std::string_view name, const StopToken& stop) const {
  return find_small<dem::Detail>("detail", find_file("details", ".json", name), stop,
                                 [](const std::string& path) { return dem::Detail(read_detail_file(path)); });
}

dem::DetailPreset read_detail_file(const std::string& path) {
  const Json json = read_object_file(path);
  Findings findings;
  const JsonReader in(json, findings);
  dem::DetailPreset preset;
  if (in.object({"seed", "region", "craters", "relief", "clods", "rocks", "albedo_variation", "published", "sources",
                 "description"})) {
    const auto seed = in.has("seed") ? in.at("seed").integer(0, kMaxSeed) : std::optional<std::int64_t>(0);
    preset.craters.seed = static_cast<std::uint64_t>(seed.value_or(0));
    preset.relief.seed = preset.clods.seed = preset.rocks.seed = preset.craters.seed;
    if (in.has("region")) preset.region = read_region(in.at("region"));
    if (in.has("craters")) read_craters(in.at("craters"), preset.craters);
    if (in.has("relief")) read_relief(in.at("relief"), preset.relief);
    if (in.has("clods")) read_clods(in.at("clods"), preset.clods);
    if (in.has("rocks")) read_rocks(in.at("rocks"), preset.rocks);
    if (in.has("albedo_variation"))
      preset.albedo_variation = preset.rocks.albedo_variation = in.number("albedo_variation", Range{0, 1.5});
    if (in.has("published")) preset.published = read_published(in.at("published"));
    if (in.has("sources")) preset.sources = read_sources(in.at("sources"));
    if (in.has("description")) in.at("description").text();
    if (!in.has("craters") && !in.has("relief") && !in.has("clods") && !in.has("rocks"))
      in.fail("has neither craters nor relief nor clods nor rocks");
  }
  // The fingerprint covers the members only: dump() sorts them and drops the file's blanks.
  const std::string text = json.dump();
  preset.fingerprint = dem::hash_of(text.data(), text.size());
  throw_if_faulty(path, findings);
  return preset;
}

void Assets::throw_if_failed(const std::string& key) const {
  const std::lock_guard lock(mutex_);
  const auto found = failures_.find(key);
  if (found == failures_.end() || StopToken::Clock::now() - found->second.since > kFailureLifetime) return;
  throw RequestError("asset_error", found->second.what);
}

void Assets::remember_failure(const std::string& key, const std::string& what) const {
  const std::lock_guard lock(mutex_);
  if (failures_.size() >= kMaxFailures) failures_.clear();
  failures_.insert_or_assign(key, Failure{StopToken::Clock::now(), what});
}

std::shared_ptr<const engine::ObjectMesh> Assets::object(std::string_view name, const StopToken& stop) const {
  for (const char* extension : {".obj", ".ply", ".gltf", ".glb"}) {
    const auto file = find_file("objects", extension, name);
    if (!file) continue;
    const auto read = [&](const std::string& path) {
      return engine::ObjectMesh(engine::read_mesh(reader_, path, stop), stop);
    };
    return find<engine::ObjectMesh>("object", *file, stop, read,
                                    [](const engine::ObjectMesh& mesh) { return mesh.bytes(); });
  }
  return nullptr;
}

std::shared_ptr<const engine::SightTable> Assets::lines_of_sight(std::string_view name, const StopToken& stop) const {
  const auto file = find_file("lines_of_sight", ".tif", name);
  if (!file) return nullptr;
  return find<engine::SightTable>(
      "lines of sight", *file, stop,
      [&](const std::string& path) { return read_sight_file(reader_, path, std::string(name), stop); },
      [](const engine::SightTable& sights) { return sights.bytes(); });
}

std::vector<std::string> Assets::names(std::string_view kind) const {
  std::vector<std::string> names;
  if (folder_.empty()) return names;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(fs::path(folder_) / kind, error))
    if (is_plain(entry.path().stem().string())) names.push_back(entry.path().stem().string());
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

std::string listed(const std::vector<std::string>& names) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
  return list.empty() ? "none" : list;
}

std::uint64_t Assets::fingerprint(const engine::Atmosphere* atmosphere) {
  if (!atmosphere) return 0;
  const auto& rows = atmosphere->rows();
  return dem::hash_of(rows.data(), rows.size() * sizeof rows[0]);
}

}  // namespace selenograph::api
