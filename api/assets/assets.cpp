#include "api/assets/assets.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <filesystem>
#include <stdexcept>

#include "api/json/ranges.h"
#include "api/message/problem.h"
#include "dem/files/files.h"
#include "dem/files/names.h"
#include "dem/support/error.h"
#include "dem/support/hash.h"
#include "engine/support/csv.h"

namespace selenograph::api {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxAssetDepth = 16;
constexpr int kMaxBands = 1000;
constexpr Range kExponent{0.1, 10};  // of a gamma
constexpr auto kFailureLasts = std::chrono::minutes(1);
constexpr std::size_t kMaxFailures = 1000;

// Names come from clients: nothing that could lead out of the folder.
bool is_plain(std::string_view name) {
  return name.size() <= 100 && dem::consists_of(name, "-_.") && name.front() != '.';
}

Json read_object_file(const std::string& path) {
  constexpr std::size_t kLongest_bytes = std::size_t{64} << 20;
  const std::string text = dem::read_head(path, kLongest_bytes);
  try {
    Json json = parse_json(text, kMaxAssetDepth);
    if (!json.is_object()) throw DataError(path, "must be a JSON object");
    return json;
  } catch (const RequestError& e) {
    throw DataError(path, e.what());
  }
}

// An asset's faults are the operator's: told with its path.
void refuse(const std::string& path, const Findings& findings) {
  if (findings.empty()) return;
  const Finding& first = findings.kept().front();
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

// Whether what a file led to is still what was read: of most, the file itself is all there is.
template <typename T>
bool current(const T&) {
  return true;
}
bool current(const dem::ValueMap& map) { return map.current(); }

}  // namespace

std::optional<Assets::Stamped> Assets::stamped(const char* kind, const char* extension, std::string_view name) const {
  if (folder_.empty() || !is_plain(name)) return std::nullopt;
  const std::string path = (fs::path(folder_) / kind / (std::string(name) + extension)).string();
  const auto state = dem::file_state(path);
  if (!state) return std::nullopt;
  return Stamped{path, dem::stamp_of(*state)};
}

template <typename T, typename Read>
std::shared_ptr<const T> Assets::find(Files<T>& files, const char* kind, const char* extension, std::string_view name,
                                      const Read& read) const {
  const auto file = stamped(kind, extension, name);
  if (!file) return nullptr;
  const auto& [path, stamp] = *file;
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = files.find(name);
        found != files.end() && found->second.stamp == stamp && current(*found->second.content))
      return found->second.content;
  }
  // Without the lock: nobody waits for a large file but those who want it.
  std::shared_ptr<const T> content;
  try {
    content = std::make_shared<const T>(read(path));
  } catch (const DataError& e) {
    throw RequestError("asset_error", e.what());
  }
  const std::lock_guard lock(mutex_);
  files.insert_or_assign(std::string(name), Known<T>{stamp, content});
  return content;
}

std::shared_ptr<const engine::Atmosphere> Assets::atmosphere(std::string_view name, const StopToken&) const {
  return find(atmospheres_, "atmospheres", ".csv", name, engine::Atmosphere::read);
}

std::shared_ptr<const Json> Assets::camera(std::string_view name) const {
  return find(cameras_, "cameras", ".json", name, read_object_file);
}

std::shared_ptr<const Json> Assets::lidar(std::string_view name) const {
  return find(lidars_, "lidars", ".json", name, read_object_file);
}

std::shared_ptr<const std::vector<std::vector<double>>> Assets::kernel(std::string_view name, const StopToken&) const {
  return find(kernels_, "kernels", ".csv", name, [](const std::string& path) {
    std::vector<std::vector<double>> rows;
    engine::each_csv_line(path, [&](std::string_view line) { rows.push_back(engine::csv_numbers(line)); });
    return rows;
  });
}

std::shared_ptr<const engine::StarCatalogue> Assets::stars(std::string_view name, const StopToken&) const {
  return find(stars_, "stars", ".csv", name, engine::StarCatalogue::read);
}

std::shared_ptr<const dem::ValueMap> Assets::map(std::string_view name, const StopToken&) const {
  return find(maps_, "maps", ".json", name,
              [&](const std::string& path) { return dem::ValueMap(read_map_file(path), map_tiles_); });
}

std::shared_ptr<const dem::ValueMap> Assets::temperature_map(std::string_view name, const StopToken&) const {
  return find(temperature_maps_, "maps", ".json", name, [&](const std::string& path) {
    dem::ValueMapOptions options = read_map_file(path);
    options.fourth_power = true;
    return dem::ValueMap(options, map_tiles_);
  });
}

namespace {

// {"quantity": "radiance_factor", and the geometry and wavelength of its I/F}; empty: rho, w or kelvin.
std::optional<dem::RadianceFactor> read_quantity(const JsonReader& in) {
  constexpr std::array kOf{"incidence_deg", "emission_deg", "phase_deg", "wavelength_um"};
  if (!in.has("quantity")) {
    for (const char* name : kOf)
      if (in.has(name)) in.fail(name, "needs \"quantity\": \"radiance_factor\"");
    return std::nullopt;
  }
  const std::pair<std::string_view, std::monostate> words[] = {{"radiance_factor", {}}};
  if (!in.at("quantity").word(Words<std::monostate>(words))) return std::nullopt;
  constexpr Range kSlant{0, 90, false, true};
  const dem::RadianceFactor at{in.number("incidence_deg", kSlant), in.number("emission_deg", kSlant),
                               in.number("phase_deg", Range{0, 180, false, true}),
                               in.number("wavelength_um", Range{0.1, 1000})};
  if (!in.good()) return std::nullopt;
  if (at.phase_deg > at.incidence_deg + at.emission_deg || at.phase_deg < std::abs(at.incidence_deg - at.emission_deg))
    in.fail("phase_deg", "must lie between the difference and the sum of incidence and emission");
  return at;
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
    map.scale = in.number("scale", kAnyNumber, map.scale), map.offset = in.number("offset", kAnyNumber, map.offset);
    map.exponent = in.number("exponent", kExponent, map.exponent);
    map.radiance_factor = read_quantity(in);
    if (in.has("no_data")) map.no_data = in.number("no_data", kAnyNumber);
    map.low = in.number("low", kAnyNumber, map.low), map.high = in.number("high", kAnyNumber, map.high);
    if (map.low > map.high) in.fail("low", "is above \"high\"");
    if (in.has("description")) in.at("description").text();
  }
  refuse(path, findings);
  return map;
}

namespace {

constexpr Range kFeature_m{0.25, 5000};  // 0.25 m is what the finest level of the lattice shows

dem::SizeFrequency read_frequency(const JsonReader& in) {
  constexpr std::size_t kMostLaws = 8;
  dem::SizeFrequency frequency;
  in.elements(1, kMostLaws, [&](const JsonReader& law) {
    if (law.object({"per_m2", "exponent"}))
      frequency.laws.push_back(
          {law.number("per_m2", Range{0, 10, true, false}), law.number("exponent", Range{0.5, 8})});
  });
  return frequency;
}

// The first diameter, of some an octave apart, above which a law has more than so many times what another has.
std::optional<double> denser_from(const dem::SizeFrequency& law, double times, const dem::SizeFrequency& other,
                                  double smallest_m, double largest_m) {
  double diameter_m = smallest_m;
  while (diameter_m < largest_m && law.above(diameter_m) <= times * other.above(diameter_m)) diameter_m *= 2;
  return diameter_m < largest_m ? std::optional(diameter_m) : std::nullopt;
}

void read_craters(const JsonReader& in, dem::CraterLaw& craters) {
  if (!in.object({"smallest_m", "largest_m", "frequency", "oldest_Ma"})) return;
  craters.smallest_m = in.number("smallest_m", kFeature_m), craters.largest_m = in.number("largest_m", kFeature_m);
  if (in.has("frequency")) craters.frequency = read_frequency(in.at("frequency"));
  craters.oldest_Ma = in.number("oldest_Ma", Range{0, 4500, true, false}, craters.oldest_Ma);
  if (!in.good()) return;
  if (!(craters.smallest_m < craters.largest_m)) return in.fail("smallest_m", "must be below largest_m");
  // Ten times equilibrium: nothing on the Moon is denser, and time goes with it.
  const auto m = denser_from(craters.frequency, 10, dem::equilibrium(), craters.smallest_m, craters.largest_m);
  if (m) in.fail("frequency", fmt::format("has more than ten times equilibrium's craters above {:g} m", *m));
}

void read_rocks(const JsonReader& in, dem::RockLaw& rocks) {
  if (!in.object({"smallest_m", "largest_m", "frequency", "on_ejecta", "half_life_Ma", "smallest_crater_m"})) return;
  constexpr Range kRock_m{0.02, 100};
  rocks.smallest_m = in.number("smallest_m", kRock_m), rocks.largest_m = in.number("largest_m", kRock_m);
  rocks.frequency = in.has("frequency") ? read_frequency(in.at("frequency")) : dem::rocks_of_viper();
  rocks.on_ejecta = in.number("on_ejecta", Range{1, 100}, rocks.on_ejecta);
  rocks.half_life_Ma = in.number("half_life_Ma", Range{0, 4500, true, false}, rocks.half_life_Ma);
  rocks.smallest_crater_m = in.number("smallest_crater_m", kFeature_m, rocks.smallest_crater_m);
  if (!in.good()) return;
  if (!(rocks.smallest_m < rocks.largest_m)) return in.fail("smallest_m", "must be below largest_m");
  // Ten times Haworth's, next to craters, too.
  const auto too_dense = [&] {
    return denser_from(rocks.frequency, 10 / rocks.on_ejecta, dem::rocks_of_haworth(), rocks.smallest_m,
                       rocks.largest_m);
  };
  // Ground as rocky as Haworth's is covered by ejecta already.
  if (!in.has("on_ejecta") && too_dense()) rocks.on_ejecta = 5;
  if (const auto m = too_dense())
    in.fail("frequency", fmt::format("has, next to fresh craters, more than ten times the rocks above {:g} m that were "
                                     "counted in Haworth's rocky parts",
                                     *m));
}

dem::Region read_region(const JsonReader& in) {
  constexpr std::size_t kMostCorners = 256;
  std::vector<Geographic> corners;
  in.elements(3, kMostCorners, [&](const JsonReader& corner) {
    if (const auto place = corner.pair(Range{-90, 90}, Range{-360, 360}))
      corners.push_back({place->first, place->second, 0});
  });
  if (!in.good()) return {};
  try {
    return dem::Region(corners);
  } catch (const std::invalid_argument& e) {
    in.fail(e.what());
    return {};
  }
}

void read_relief(const JsonReader& in, dem::ReliefLaw& relief) {
  if (!in.object({"hurst", "deviation_m", "baseline_m", "shortest_m", "longest_m"})) return;
  relief.hurst = in.number("hurst", Range{0.1, 1, false, true}, relief.hurst);
  relief.deviation_m = in.number("deviation_m", Range{0, 1000, true, false});
  relief.baseline_m = in.number("baseline_m", Range{0.01, 1e5});
  relief.shortest_m = in.number("shortest_m", kFeature_m), relief.longest_m = in.number("longest_m", kFeature_m);
  if (in.good() && !(relief.shortest_m < relief.longest_m)) in.fail("shortest_m", "must be below longest_m");
}

dem::PublishedSlopes read_published(const JsonReader& in) {
  dem::PublishedSlopes slopes;
  if (!in.object({"median_slope_deg", "baseline_m", "hurst", "source"})) return slopes;
  slopes.median_slope_deg = in.number("median_slope_deg", Range{0, 45, true, false});
  slopes.baseline_m = in.number("baseline_m", Range{0.01, 1e5});
  slopes.hurst = in.number("hurst", Range{0.1, 1, false, true});
  in.at("source").text();
  return slopes;
}

}  // namespace

std::shared_ptr<const dem::Detail> Assets::detail(std::string_view name, const StopToken&) const {
  return find(details_, "details", ".json", name,
              [](const std::string& path) { return dem::Detail(read_detail_file(path)); });
}

dem::DetailPreset read_detail_file(const std::string& path) {
  const Json json = read_object_file(path);
  Findings findings;
  const JsonReader in(json, findings);
  dem::DetailPreset preset;
  if (in.object({"seed", "region", "craters", "relief", "rocks", "published", "description"})) {
    constexpr std::int64_t kLargestSeed = std::int64_t{1} << 53;
    const auto seed = in.has("seed") ? in.at("seed").integer(0, kLargestSeed) : std::optional<std::int64_t>(0);
    preset.craters.seed = static_cast<std::uint64_t>(seed.value_or(0));
    preset.relief.seed = preset.rocks.seed = preset.craters.seed;
    if (in.has("region")) preset.region = read_region(in.at("region"));
    if (in.has("craters")) read_craters(in.at("craters"), preset.craters);
    if (in.has("relief")) read_relief(in.at("relief"), preset.relief);
    if (in.has("rocks")) read_rocks(in.at("rocks"), preset.rocks);
    if (in.has("published")) preset.published = read_published(in.at("published"));
    if (in.has("description")) in.at("description").text();
    if (!in.has("craters") && !in.has("relief") && !in.has("rocks"))
      in.fail("has neither craters nor relief nor rocks");
  }
  const std::string text = json.dump();
  preset.fingerprint = dem::hash_of(text.data(), text.size());
  refuse(path, findings);
  return preset;
}

void Assets::refuse_failed(const std::string& key) const {
  const std::lock_guard lock(mutex_);
  const auto found = failed_.find(key);
  if (found == failed_.end() || StopToken::Clock::now() - found->second.since > kFailureLasts) return;
  throw RequestError("asset_error", found->second.what);
}

void Assets::remember_failed(const std::string& key, const std::string& what) const {
  const std::lock_guard lock(mutex_);
  if (failed_.size() >= kMaxFailures) failed_.clear();
  failed_.insert_or_assign(key, Failure{StopToken::Clock::now(), what});
}

std::shared_ptr<const engine::ObjectMesh> Assets::object(std::string_view name, const StopToken& stop) const {
  for (const char* extension : {".obj", ".ply", ".gltf", ".glb"}) {
    const auto file = stamped("objects", extension, name);
    if (!file) continue;
    const std::string& path = file->path;
    const auto read = [&] {
      auto mesh = std::make_shared<const engine::ObjectMesh>(reader_.read(path, stop), stop);
      return Meshes::Loaded{mesh, mesh->bytes()};
    };
    // A file that changed has another key; what it was before goes when its room is needed.
    const std::string key = fmt::format("{}:{:016x}", path, file->stamp);
    refuse_failed(key);
    try {
      return meshes_.get(key, read, stop);
    } catch (const DataError& e) {
      remember_failed(key, e.what());
      throw RequestError("asset_error", e.what());
    }
  }
  return nullptr;
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
