// The DEM round trip (SENSOR++ paper, section 4 and figure 5): what cameras see of a tile, taken back to the tile's own
// posts and compared with what the file says there.
//
// exact:  rays through the posts, from cameras that look down. What differs is the engine's.
// camera: ordinary frames; the pixels' surface points are resampled to the posts. What differs is the engine's and the
//         sampling's: pixels don't meet posts, and the plane between three of them cuts a crest between posts off.
// The file's values come from dem/raster.h: neither lattice nor pyramid has touched them. Where the mesh hasn't all of
// a tile's posts (resampled products; every second one or fewer poleward of 75.5 degrees, see dem/grid/lattice.h),
// differences in mode exact are what that costs.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "dem/gdal/raster.h"
#include "engine/renderer.h"

namespace selenograph::engine {

enum class RoundTripMode { exact, camera };

struct RoundTripRequest {
  // The tile is the finest that holds this place, the window is around it.
  double lat_deg = 0, lon_deg = 0;
  double height_m = 20000;  // of the cameras, above the ground beneath them
  RoundTripMode mode = RoundTripMode::exact;
  // Posts along each side of the window, fewer where the tile ends; 0: the whole tile.
  int posts = 1024;
  // Pixel footprint straight below the camera as a multiple of the post spacing. Mode camera only, as the next.
  double footprint_ratio = 1;
  double max_error_px = 0;  // level of detail of the frames; 0: the finest posts
};

// Part of a tile. Row 0 is the northernmost.
struct PostWindow {
  dem::RasterInfo tile;
  int x0 = 0, y0 = 0, width = 0, height = 0;
  std::size_t size() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
  std::size_t index(int row, int col) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(width) + static_cast<std::size_t>(col);
  }
  Geographic place(int row, int col) const { return dem::place_of_post(tile, x0 + col, y0 + row); }
  // Between neighbouring posts.
  double lat_step_deg() const { return place(0, 0).lat_deg - place(1, 0).lat_deg; }
  double lon_step_deg() const { return wrap_lon_deg(place(0, 1).lon_deg - place(0, 0).lon_deg); }
};

struct RoundTrip {
  PostWindow window;
  std::vector<float> original_m;    // the file's values; NaN: void
  std::vector<float> difference_m;  // extracted - original; NaN: not compared
  // posts = compared + hidden + missed + voids + elsewhere.
  std::size_t compared = 0;
  std::size_t hidden = 0;        // nearer terrain stands before the post
  std::size_t missed = 0;        // nothing was met there: next to voids or beyond the last tile
  std::size_t voids = 0;         // no value in the tile
  std::size_t elsewhere = 0;     // a finer tile lies above this one and is what is seen
  std::size_t stations = 0;      // camera positions
  double pixel_footprint_m = 0;  // straight below the camera; mode camera only
};

// Told the share that is done, 0..1, from the calling thread.
using Progress = std::function<void(double share)>;

// Takes 8 bytes per post of the window, and what one station needs on top. Throws ImpossibleRequest where no tile
// is, the tile is not in geographic coordinates, or the cameras stand too low for its spacing; DataError and Cancelled
// as Renderer does.
RoundTrip round_trip(const Renderer& renderer, const RoundTripRequest& request, const Progress& progress = {},
                     const StopToken& stop = {});

}  // namespace selenograph::engine
