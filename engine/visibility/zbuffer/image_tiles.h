// The image in tiles, and which strips of the mesh may be in each.
//
// A lens bends what the image plane shows straight. Its pixels are then samples in the plane before the lens: each tile
// has an affine map from that plane to its pixels, close enough that a sample lies within a fraction of a pixel of its
// place in the tile (TileView::slack), and triangles, which an affine map leaves triangles, are tested at the samples
// themselves. So the z-buffer is exact at the centres of a distorted image's pixels, too.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/camera/pixel_rays.h"
#include "engine/camera/view.h"
#include "engine/scene/raster_mesh.h"
#include "engine/visibility/zbuffer/raster_kernels.h"

namespace selenograph::engine {

// Where a strip may be in the image, in pixels of the camera without its lens; empty when it can't be in view.
struct StripBox {
  float low[2], high[2];
  bool leaves_guard_band;  // some of its vertices may, in some tile: see in_guard_band
  bool empty() const { return !(low[0] <= high[0] && low[1] <= high[1]); }
};

// One tile of the image.
struct ImageTile {
  int x0, y0, width, height;
  float low[2], high[2];              // of its samples, in pixels of the camera without its lens
  std::vector<std::uint32_t> strips;  // that may be in it
};

class ImageTiling {
 public:
  // Both outlive it.
  ImageTiling(const RasterMesh& mesh, const View& view);

  bool bends() const { return bends_; }  // whether there is distortion

  // Tiles of the image whose pixels are seen at places (dx, dy) beside their centres. `rays`: there, of a camera with
  // distortion. Parallel.
  void lay(double dx, double dy, const PixelRays& rays, std::vector<StripBox>& boxes,
           std::vector<ImageTile>& tiles) const;

  // Draws a tile's strips. `rays`, dx, dy and boxes as above.
  void draw(const ImageTile& tile, double dx, double dy, const PixelRays& rays, const std::vector<StripBox>& boxes,
            TileBuffer& buffer) const;

 private:
  TileView tile_view(const Eigen::Matrix2d& a, const Eigen::Vector2d& b, int width, int height) const;
  TileView undistorted_view(double x0, double y0, int width, int height) const;
  TileView lens_view(const ImageTile& tile, const PixelRays& rays, TileBuffer& buffer) const;
  StripBox box_of(const Strip& strip, const TileView& whole) const;
  void bound(ImageTile& tile, const PixelRays& rays) const;

  const RasterMesh& mesh_;
  const View& view_;
  const Camera& camera_;
  bool bends_;
};

}  // namespace selenograph::engine
