// The operator's assets: files that requests refer to by name, one subfolder per kind.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "api/json/json_reader.h"
#include "dem/base/cache.h"
#include "dem/base/stop_token.h"
#include "dem/detail/detail.h"
#include "dem/files/files.h"
#include "dem/value_maps/value_map.h"
#include "engine/camera/sight_table.h"
#include "engine/radiometry/atmosphere.h"
#include "engine/sky/star_catalogue.h"
#include "engine/support/confined_reader.h"
#include "engine/visibility/objects/object_mesh.h"

namespace selenograph::api {

// Thread-safe: const functions may be called concurrently. A file is read once, and again when it has changed. If
// several threads request it at once, one reads and the others wait, each until its own `stop`. Files that no request
// uses stay cached while all fit into ReaderOptions::max_bytes; the least recently used is evicted first.
//
// Functions return null if there is no such file. They throw RequestError("asset_error") naming a file that cannot be
// used, which is then not read again for a minute unless it changes, and Cancelled when `stop` is requested.
class Assets {
 public:
  // Memory for tiles of all maps.
  static constexpr std::size_t kMapTilesBytes = std::size_t{128} << 20;

  // An empty `folder` means no assets.
  explicit Assets(std::string folder = {}, engine::ReaderOptions options = {})
      : folder_(std::move(folder)), files_(options.max_bytes), reader_(std::move(options)) {}

  // Returns atmospheres/NAME.csv; format: engine::Atmosphere::read.
  std::shared_ptr<const engine::Atmosphere> atmosphere(std::string_view name, const StopToken& stop = {}) const;
  // Returns cameras/NAME.json, an object whose members the request's reader checks.
  std::shared_ptr<const Json> camera(std::string_view name, const StopToken& stop = {}) const;
  // Returns lidars/NAME.json, an object whose members the request's reader checks.
  std::shared_ptr<const Json> lidar(std::string_view name, const StopToken& stop = {}) const;

  // Returns map_errors/NAME.json, an object whose members the request's reader checks.
  std::shared_ptr<const Json> map_error(std::string_view name, const StopToken& stop = {}) const;

  // Returns objects/NAME.obj, .ply, .gltf or .glb, the first of these that exists, read by engine::read_mesh.
  std::shared_ptr<const engine::ObjectMesh> object(std::string_view name, const StopToken& stop = {}) const;
  // Returns the memory of cached files: meshes with their ray-tracing structures, star catalogues and all others.
  std::size_t mesh_bytes() const { return files_.bytes(); }

  // Returns maps/NAME.json; format: read_map_file. It is opened again when its raster has changed.
  std::shared_ptr<const dem::ValueMap> map(std::string_view name, const StopToken& stop = {}) const;
  // Returns the same file for temperatures T, of which means are taken as T^4.
  std::shared_ptr<const dem::ValueMap> temperature_map(std::string_view name, const StopToken& stop = {}) const;

  // Returns details/NAME.json; format: read_detail_file.
  std::shared_ptr<const dem::Detail> detail(std::string_view name, const StopToken& stop = {}) const;

  // Returns kernels/NAME.csv, rows of weights.
  std::shared_ptr<const std::vector<std::vector<double>>> kernel(std::string_view name,
                                                                 const StopToken& stop = {}) const;

  // Returns stars/NAME.csv; format: engine::StarCatalogue::read.
  std::shared_ptr<const engine::StarCatalogue> stars(std::string_view name, const StopToken& stop = {}) const;

  // Returns lines_of_sight/NAME.tif; format: read_sight_file.
  std::shared_ptr<const engine::SightTable> lines_of_sight(std::string_view name, const StopToken& stop = {}) const;

  // Returns the sorted names, without extension, of a kind's files ("atmospheres", "cameras", "details", "kernels",
  // "lidars", "lines_of_sight", "map_errors", "maps", "objects", "stars").
  std::vector<std::string> names(std::string_view kind) const;

  // Returns a hash of an atmosphere's rows, so that a frame's ETag changes with them; 0 for null.
  static std::uint64_t fingerprint(const engine::Atmosphere* atmosphere);

 private:
  // A file and its state (size and time of change) when it was looked up.
  struct FileVersion {
    std::string path;
    dem::FileState state;
    // Returns the cache key of this version. `type` distinguishes contents that are read differently from one file.
    std::string key(const char* type) const;
  };
  // Base of the cached contents of any type. Callers get a pointer to the value that shares ownership of its ContentOf.
  struct Content {
    virtual ~Content() = default;
  };
  template <typename T>
  struct ContentOf : Content {
    template <typename Make>
    explicit ContentOf(const Make& make) : value(make()) {}
    T value;
  };
  using Files = dem::Cache<std::string, Content>;  // by FileVersion::key()

  // Failure to read a file. It is remembered for a minute, which limits the cost of requests that name a bad file.
  struct Failure {
    StopToken::Clock::time_point since;
    std::string what;
  };
  // Throws the remembered failure of a file version, if there is one.
  void throw_if_failed(const std::string& key) const;
  void remember_failure(const std::string& key, const std::string& what) const;

  // Returns KIND/NAME.EXTENSION and its state; empty if there is no such file.
  std::optional<FileVersion> find_file(const char* kind, const char* extension, std::string_view name) const;

  // Returns a file's content from the cache, or reads it with read(path) -> T, which takes bytes_of(T) of memory.
  template <typename T, typename Read, typename BytesOf>
  std::shared_ptr<const T> find(const char* type, const FileVersion& file, const StopToken& stop, const Read& read,
                                const BytesOf& bytes_of) const;
  // Returns the same for a file whose memory is bounded by a multiple of its size; null for no file.
  template <typename T, typename Read>
  std::shared_ptr<const T> find_small(const char* type, const std::optional<FileVersion>& file, const StopToken& stop,
                                      const Read& read) const;
  // Returns maps/NAME.json, whose means are taken as fourth powers if `fourth_power` is true; null for no file.
  std::shared_ptr<const dem::ValueMap> find_map(const char* type, std::string_view name, bool fourth_power,
                                                const StopToken& stop) const;

  std::string folder_;
  std::shared_ptr<dem::ValueMapTiles> map_tiles_ = dem::make_value_map_tiles(kMapTilesBytes);
  mutable Files files_;
  mutable std::mutex mutex_;
  mutable std::map<std::string, Failure> failures_;  // by FileVersion::key(), guarded by mutex_
  mutable std::timed_mutex reading_stars_;           // held while a star catalogue is read
  engine::ConfinedReader reader_;
};

// Reads a map's description:
//   {"file": "RASTER",                     GeoTIFF, VRT, AAIGrid, PNG, JPEG, PDS, ISIS3; a relative path starts at the
//   description's folder
//    "bands": [1, 2, 3],                   their mean is used; left out: all but alpha
//    "extent": {"south_deg", "north_deg", "west_deg", "east_deg"},   of a raster without georeferencing
//    "scale": 1, "offset": 0, "exponent": 1,  value = (scale * sample + offset)^exponent
//    "quantity": "radiance_factor",        values are I/F at
//    "incidence_deg", "emission_deg", "phase_deg", "wavelength_um",   these, all required; left out: rho, w or kelvin
//    "no_data": N,                         another no-data sample, besides the file's own
//    "low": L, "high": H,                  values are clamped
//    "description": "..."}
// Throws DataError naming the description or the raster.
dem::ValueMapOptions read_map_file(const std::string& path);

// Reads a detail's description. Any of craters, relief, clods and rocks may be left out, but not all of them:
//   {"seed": N,
//    "region": [[lat_deg, lon_deg], ...],            corners of a polygon in order that contains the centres of craters
//                                                    and rocks; left out: everywhere (dem::Region)
//    "craters": {"smallest_m", "largest_m",          diameters; the smallest at least 0.00390625
//                "frequency": [{"per_m2", "exponent"}, ...],   the minimum of these power laws (cumulative), of the
//                                                    craters that are visible; left out: equilibrium (Trask 1966)
//                "oldest_Ma": 3500},             of the surface
//    "relief": {"hurst": 0.9, "deviation_m", "baseline_m", "shortest_m", "longest_m",   RMS height difference over
//                                                    a baseline; wavelengths
//               "min_factor": 1,                   of amplitudes, over level posts (dem::ReliefLaw)
//               "fine": {"below_m", "hurst": 0.52, "slope"}},   law of shorter wavelengths (dem::ReliefLaw::Fine)
//    "clods": {"cover", "smallest_m", "largest_m"},   share of ground that an octave covers; sizes
//    "rocks": {"smallest_m", "largest_m",            diameters; the smallest at least 0.02
//              "frequency": [{"per_m2", "exponent"}, ...],   between craters; left out: dem::rocks_of_viper()
//              "on_ejecta": 25, "half_life_Ma": 60, "smallest_crater_m": 30, "smallest_fragment_m"},   as in
//                                                    dem::RockLaw; on_ejecta left out: 5 where 25 would be more than
//                                                    ten times Haworth's rocks
//    "published": {"median_slope_deg", "baseline_m", "hurst", "source"},   measured slopes, for `unit.ground`
//    "sources": {"craters": {"measured", "extrapolated"}, ...},   of craters, relief, clods and rocks: texts
//    "description": "..."}
// Throws DataError naming the description and the member.
dem::DetailPreset read_detail_file(const std::string& path);

// Returns "a, b, c", or "none" for an empty list.
std::string listed(const std::vector<std::string>& names);

}  // namespace selenograph::api
