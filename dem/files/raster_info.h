// Properties of a DEM file that are known without reading its posts.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "dem/grid/geodesy.h"
#include "dem/grid/post_grid.h"

namespace selenograph::dem {

// Lunar heights are between -9.1 and +10.8 km. Values beyond this limit (infinity, an undeclared DUMMY, a wrong unit)
// are read as no-data.
inline constexpr double kFarthestHeight_m = 1e5;

enum class Projection {
  geographic,  // equirectangular, too
  polar_stereographic,
  stereographic,  // about another place
  orthographic,
  mercator,
  transverse_mercator
};
// As above: "geographic".
const char* name_of(Projection projection);

struct RasterInfo {
  std::string path;    // as opened (for PDS products, the label)
  std::string name;    // file name without folder and extension: what `source` lists
  std::string format;  // "PDS3 Kaguya", "PDS3 LOLA", "GTiff", ...
  int width = 0, height = 0;
  PostGrid grid;
  // Members from here to lattice_level are derived from size and grid: see set_grid.
  double posts_per_degree = 0;   // along a meridian; for a projected raster as PlanePosts::posts_per_degree
  double post_spacing_m = 0;     // along a meridian on the sphere
  Footprint footprint;           // tight around the posts (outermost posts are on its border)
  bool wraps_longitude = false;  // covers 360 degrees: x is periodic
  // When every post lies at an integer multiple of 2^-n degree (both axes): n. Posts are then copied, never resampled.
  std::optional<int> lattice_level;
  std::string datum;                 // e.g. "sphere 1737.4 km, height" or "planetary radius, converted"
  double quantisation_m = 0;         // step between representable heights (1 for integer metres), 0 for float
  std::optional<double> void_value;  // in file units
  std::uint64_t bytes = 0;           // size of the file(s) that hold the posts
  std::int64_t modified_ns = 0;      // newest modification time of label and data
  std::uint64_t stamp = 0;           // hash of the stamps of all its files, and of how its samples are read
  bool on_network = false;           // it, or a source of a VRT, is remote: reads may take seconds
  std::string damage;                // why the posts of a located file cannot be read; empty: they can
  std::string gap;                   // which of a VRT's sources are missing: posts there can't be read; empty: none
  bool synthetic = false;            // its label says that the terrain was generated: the sample terrain

  Projection projection() const;
};

// Sets the grid of a raster of known size, and everything derived from it. A geographic grid that repeats its first
// meridian (0 and 360) loses the copy. Throws DataError naming the file when the grid is not a valid map of the Moon:
// non-finite numbers, posts more than 30 degrees or less than 2^-20 degree apart, more than 2^24 along a side.
void set_grid(RasterInfo& info, const PostGrid& grid);

// Lattice level at which a file's posts are (nearly) vertices.
int level_needed(const RasterInfo& info);

// Post coordinates of a place. For a raster that wraps x is in [0, width). For many places of a raster on a plane
// PlanePosts is faster.
PostXY locate(const RasterInfo& info, double lat_deg, double lon_deg);

// Inverse of locate(): place of a post; height_m is 0. For posts that are not on the Moon see PlanePosts.
Geographic place_of_post(const RasterInfo& info, int x, int y);

}  // namespace selenograph::dem
