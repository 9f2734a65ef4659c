// The DEM round trip (SENSOR++ paper, section 4 and figure 5): surface points of a tile, as cameras see them, are
// resampled to the tile's own posts and compared with the file's heights.
//
// Mode exact: rays through the posts, from cameras that look down. Differences are errors of the engine. Mode camera:
// ordinary frames, whose surface points are resampled to the posts. Differences also contain the sampling error: pixels
// do not coincide with posts, and the plane between three of them cuts off a crest. The file's heights are read
// directly (dem/gdal/raster.h), not through lattice or pyramid. Where the mesh does not have all of a tile's posts
// (resampled products; every second post or fewer poleward of 75.5 degrees, see dem/grid/lattice.h), differences in
// mode exact include that loss.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "dem/gdal/raster.h"
#include "engine/renderer.h"

namespace selenograph::engine {

enum class RoundTripMode { exact, camera };

struct RoundTripRequest {
  // Centre of the window, which is moved inwards at the tile's border. The finest tile that contains it is used.
  double lat_deg = 0, lon_deg = 0;
  double height_m = 20000;  // height of the cameras above the ground below them
  RoundTripMode mode = RoundTripMode::exact;
  // Posts along each side of the window, fewer where the tile is smaller; 0: the whole tile.
  int posts = 1024;
  // Pixel footprint below the camera as a multiple of the post spacing. Mode camera only, like the next.
  double footprint_ratio = 1;
  double max_error_px = 0;  // for the frames; 0: the finest posts
};

// A window of a tile's posts. Row 0 is the northernmost. In a tile that goes around the Moon columns may be negative,
// or beyond the last: they wrap around.
struct PostWindow {
  dem::RasterInfo tile;
  int x0 = 0, y0 = 0, width = 0, height = 0;
  std::size_t size() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
  std::size_t index(int row, int col) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(width) + static_cast<std::size_t>(col);
  }
  Geographic place(int row, int col) const { return dem::place_of_post(tile, x0 + col, y0 + row); }
  // Spacing of neighbouring posts.
  double lat_step_deg() const { return place(0, 0).lat_deg - place(1, 0).lat_deg; }
  double lon_step_deg() const { return wrap_lon_deg(place(0, 1).lon_deg - place(0, 0).lon_deg); }
};

struct RoundTrip {
  PostWindow window;
  std::vector<float> original_m;    // the file's values; NaN: void
  std::vector<float> difference_m;  // extracted - original; NaN: not compared
  // posts = compared + hidden + missed + voids + elsewhere.
  std::size_t compared = 0;
  std::size_t hidden = 0;        // nearer terrain hides the post
  std::size_t missed = 0;        // no hit: next to no-data, beyond the last tile; in mode camera next to a pole
  std::size_t voids = 0;         // no-data in the tile
  std::size_t elsewhere = 0;     // a finer tile covers this one and is seen instead
  std::size_t stations = 0;      // camera positions
  double pixel_footprint_m = 0;  // below the camera; mode camera only
};

// Called with the finished share, 0..1, from the calling thread.
using Progress = std::function<void(double share)>;

// Runs the round trip. Takes 8 bytes per post of the window, plus the memory of one camera station. Throws
// ImpossibleRequest when there is no tile, the tile is not in geographic coordinates, or the cameras are too low for
// its spacing; DataError and Cancelled as Renderer does.
RoundTrip round_trip(const Renderer& renderer, const RoundTripRequest& request, const Progress& progress = {},
                     const StopToken& stop = {});

}  // namespace selenograph::engine
