// Frames by z-buffer and irregular shadow map: strips of the mesh are drawn into tiles of the image, each pixel's point
// is refined in double by the code that rays use, and shadows are cast on exactly these points.
//
// A lens bends what the image plane shows straight. Its pixels are then samples in the plane before the lens: each tile
// has an affine map from that plane to its pixels, close enough that a sample lies within a fraction of a pixel of its
// place in the tile (TileView::slack), and triangles, which an affine map leaves triangles, are tested at the samples
// themselves. So the z-buffer is exact at the centres of a distorted image's pixels, too.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/scene/raster_mesh.h"
#include "engine/support/pool.h"
#include "engine/visibility/pixel_store.h"
#include "engine/visibility/zbuffer/raster_kernels.h"
#include "engine/visibility/zbuffer/shadow_map.h"
#include "engine/visibility/zbuffer/sun_disc.h"

namespace selenograph::engine {

// Where a strip may be in the image, in pixels of the camera without its lens; empty when it can't be in view. `wide`:
// not all of its vertices are plain in every tile.
struct StripBox {
  float low[2], high[2];
  bool wide;
  bool empty() const { return !(low[0] <= high[0] && low[1] <= high[1]); }
};

// One tile of the image.
struct ImageTile {
  int x0, y0, width, height;
  float low[2], high[2];              // of its samples, in pixels of the camera without its lens
  std::vector<std::uint32_t> strips;  // that may be in it
};

// All that a frame needs while it is drawn; kept from frame to frame.
struct FrameScratch {
  std::vector<StripBox> boxes;
  std::vector<ImageTile> tiles;
  std::vector<LightSamples> samples;  // per tile
  std::vector<float> layer;           // radiance of one sub-pixel sample
  std::vector<float> bases;           // per pixel, without the Sun; empty: the same everywhere
  LightScratch light;
  DiscScratch disc;
  Pool<TileBuffer> buffers;  // one per thread
  std::size_t bytes() const;
};

// Parallel over tiles in the caller's task arena; stops between tiles and between bands of the shadow map.
void draw_pixels(const RasterMesh& mesh, PixelStore& store, const ObjectsInFrame& objects, const StopToken& stop,
                 FrameScratch& scratch);

}  // namespace selenograph::engine
