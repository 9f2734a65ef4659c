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
#include "engine/radiometry/atmosphere.h"
#include "engine/sky/star_catalogue.h"
#include "engine/visibility/meshes/mesh_reader.h"
#include "engine/visibility/objects/object_mesh.h"

namespace selenograph::api {

// Thread-safe: const functions may be called concurrently. A file is read once, and again when it has changed; of
// concurrent requests for it, one reads and the others wait, each until its own `stop`. Files that no request uses are
// kept while all fit into MeshReaderOptions::max_bytes, least recently used ones are dropped first. Functions return
// null if there is no such file, and throw RequestError("asset_error") naming the file when it cannot be used: it is
// not tried again for a minute unless it changes. Cancelled is thrown when `stop` says so.
class Assets {
 public:
  // Memory for tiles of maps.
  static constexpr std::size_t kMapTilesBytes = std::size_t{128} << 20;

  // `folder` empty: no assets.
  explicit Assets(std::string folder = {}, engine::MeshReaderOptions meshes = {})
      : folder_(std::move(folder)), files_(meshes.max_bytes), reader_(std::move(meshes)) {}

  // atmospheres/NAME.csv; format: engine::Atmosphere::read.
  std::shared_ptr<const engine::Atmosphere> atmosphere(std::string_view name, const StopToken& stop = {}) const;
  // cameras/NAME.json: an object, whose members the request's reader checks.
  std::shared_ptr<const Json> camera(std::string_view name, const StopToken& stop = {}) const;
  // lidars/NAME.json: likewise.
  std::shared_ptr<const Json> lidar(std::string_view name, const StopToken& stop = {}) const;

  // objects/NAME.obj, .ply, .gltf or .glb, the first of these that exists, read by engine::MeshReader.
  std::shared_ptr<const engine::ObjectMesh> object(std::string_view name, const StopToken& stop = {}) const;
  // Memory of cached files: meshes with their ray-tracing structures, star catalogues and all others.
  std::size_t mesh_bytes() const { return files_.bytes(); }

  // maps/NAME.json; format: read_map_file. It is opened again when its raster has changed.
  std::shared_ptr<const dem::ValueMap> map(std::string_view name, const StopToken& stop = {}) const;
  // The same file, whose means are those of T^4.
  std::shared_ptr<const dem::ValueMap> temperature_map(std::string_view name, const StopToken& stop = {}) const;

  // details/NAME.json; format: read_detail_file.
  std::shared_ptr<const dem::Detail> detail(std::string_view name, const StopToken& stop = {}) const;

  // kernels/NAME.csv: rows of weights.
  std::shared_ptr<const std::vector<std::vector<double>>> kernel(std::string_view name,
                                                                 const StopToken& stop = {}) const;

  // stars/NAME.csv; format: engine::StarCatalogue::read.
  std::shared_ptr<const engine::StarCatalogue> stars(std::string_view name, const StopToken& stop = {}) const;

  // Sorted names, without extension, of a kind's files ("atmospheres", "cameras", "details", "kernels", "lidars",
  // "maps", "objects", "stars").
  std::vector<std::string> names(std::string_view kind) const;

  // Hash of an atmosphere's rows, so that a frame's ETag changes with them; 0 for null.
  static std::uint64_t fingerprint(const engine::Atmosphere* atmosphere);

 private:
  struct Stamped {
    std::string path;
    dem::FileState state;
    std::string key(const char* type) const;  // `type` distinguishes contents of one file
  };
  // A file's content. A pointer to the content shares ownership of the whole.
  struct Content {
    virtual ~Content() = default;
  };
  template <typename T>
  struct ContentOf : Content {
    template <typename Make>
    explicit ContentOf(const Make& make) : value(make()) {}
    T value;
  };
  using Files = dem::Cache<std::string, Content>;  // by type, path and stamp

  // A failure is remembered for a minute, so that the cost of reading a bad file is limited.
  struct Failure {
    StopToken::Clock::time_point since;
    std::string what;
  };
  void refuse_failed(const std::string& key) const;
  void remember_failed(const std::string& key, const std::string& what) const;

  // Empty if there is no such file.
  std::optional<Stamped> stamped(const char* kind, const char* extension, std::string_view name) const;

  // Reads with read(path) -> T, which takes bytes_of(T) of memory.
  template <typename T, typename Read, typename BytesOf>
  std::shared_ptr<const T> find(const char* type, const Stamped& file, const StopToken& stop, const Read& read,
                                const BytesOf& bytes_of) const;
  // The memory follows from the file's size.
  template <typename T, typename Read>
  std::shared_ptr<const T> find_small(const char* type, const std::optional<Stamped>& file, const StopToken& stop,
                                      const Read& read) const;
  std::shared_ptr<const dem::ValueMap> find_map(const char* type, std::string_view name, bool fourth_power,
                                                const StopToken& stop) const;

  std::string folder_;
  // Tiles of all maps.
  std::shared_ptr<dem::ValueMapTiles> map_tiles_ = dem::make_value_map_tiles(kMapTilesBytes);
  mutable Files files_;
  mutable std::mutex mutex_;
  mutable std::map<std::string, Failure> failed_;  // by a file's key
  mutable std::timed_mutex reading_stars_;
  engine::MeshReader reader_;
};

// A map's description:
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

// A detail's description; any of craters, relief and rocks may be left out, but not all:
//   {"seed": N,
//    "region": [[lat_deg, lon_deg], ...],            corners of a polygon in order that contains the centres of craters
//                                                    and rocks; left out: everywhere (dem::Region)
//    "craters": {"smallest_m", "largest_m",          diameters; the smallest at least 0.25
//                "frequency": [{"per_m2", "exponent"}, ...],   the minimum of these power laws (cumulative), of the
//                                                    craters that are visible; left out: equilibrium (Trask 1966)
//                "oldest_Ma": 3500},             of the surface
//    "relief": {"hurst": 0.9, "deviation_m", "baseline_m", "shortest_m", "longest_m"},   RMS height difference over
//                                                    a baseline; wavelengths
//    "rocks": {"smallest_m", "largest_m",            diameters; the smallest at least 0.02
//              "frequency": [{"per_m2", "exponent"}, ...],   between craters; left out: dem::rocks_of_viper()
//              "on_ejecta": 25, "half_life_Ma": 60, "smallest_crater_m": 30},   as in dem::RockLaw; on_ejecta left
//                                                    out: 5 where 25 would be more than ten times Haworth's rocks
//    "published": {"median_slope_deg", "baseline_m", "hurst", "source"},   measured slopes, for `verify ground`
//    "description": "..."}
// Throws DataError naming the description and the member.
dem::DetailPreset read_detail_file(const std::string& path);

// "a, b, c" or "none".
std::string listed(const std::vector<std::string>& names);

}  // namespace selenograph::api
