// Properties of a DEM file that are known without reading its posts.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "dem/grid/geodesy.h"
#include "dem/grid/post_grid.h"

namespace selenograph::dem {

// Largest absolute height. Lunar heights are between -9.1 and +10.8 km; values beyond this limit (infinity, an
// undeclared DUMMY, a wrong unit) are read as no-data.
inline constexpr double kFarthestHeight_m = 1e5;

enum class Projection {
  geographic,  // equirectangular, too
  polar_stereographic,
  stereographic,  // centred elsewhere than on a pole
  orthographic,
  mercator,
  transverse_mercator
};
// Returns the enumerator's name, e.g. "geographic".
const char* name_of(Projection projection);

// Metadata of one DEM file.
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
  // Level n if every post lies at an integer multiple of 2^-n degree on both axes, else empty. Posts are then copied,
  // never resampled.
  std::optional<int> lattice_level;
  std::string datum;                 // e.g. "sphere 1737.4 km, height" or "planetary radius, converted"
  double quantisation_m = 0;         // step between representable heights (1 for integer metres), 0 for float
  std::optional<double> void_value;  // in file units
  std::uint64_t bytes = 0;           // size of the file(s) that hold the posts
  std::int64_t modified_ns = 0;      // newest modification time of label and data
  std::uint64_t stamp = 0;           // hash of the stamps of all its files, and of the conversion of its samples
  bool on_network = false;           // the file, or a source of a VRT, is remote: reads may take seconds
  std::string damage;                // reason why the posts of a located file cannot be read; empty: they can
  std::string gap;                   // missing sources of a VRT, whose posts cannot be read; empty: none
  bool synthetic = false;            // the label marks the terrain as generated: the sample terrain

  Projection projection() const;
};

// Sets the grid of a raster whose size is set, and all members derived from it. A geographic grid that repeats its
// first meridian (0 and 360) loses the copy. Throws DataError naming the file when the grid is not a valid map of the
// Moon: non-finite numbers, posts more than 30 degrees or less than 2^-20 degree apart, more than 2^24 along a side.
void set_grid(RasterInfo& info, const PostGrid& grid);

// Returns the lattice level at which a file's posts are (nearly) vertices.
int level_needed(const RasterInfo& info);

// Returns the post coordinates of a position. For a raster that wraps, x is in [0, width). For many positions of a
// raster on a plane PlanePosts is faster.
PostXY locate(const RasterInfo& info, double lat_deg, double lon_deg);

// Returns the position of a post: the inverse of locate(); height_m is 0. For posts that are not on the Moon see
// PlanePosts.
Geographic place_of_post(const RasterInfo& info, int x, int y);

}  // namespace selenograph::dem
