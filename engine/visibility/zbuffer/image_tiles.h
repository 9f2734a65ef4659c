// Divides the image into tiles and finds the strips of the mesh that may be in each.
//
// With distortion, pixels are samples in the undistorted image plane: each tile has an affine map from that plane to
// its pixels, close enough that a sample lies within a fraction of a pixel of its place in the tile (TileView::slack).
// Triangles, which stay triangles under an affine map, are tested at the samples themselves, so the z-buffer is exact
// at the pixel centres of a distorted image, too.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "engine/camera/pixel_rays.h"
#include "engine/camera/row_fit.h"
#include "engine/camera/row_views.h"
#include "engine/scene/raster_mesh.h"
#include "engine/visibility/zbuffer/raster_kernels.h"

namespace selenograph::engine {

// Bounding box of a strip in the image, in pixels of the undistorted camera; empty if the strip is out of view.
struct StripBox {
  float low[2], high[2];
  bool leaves_guard_band;  // vertices may leave the guard band of a tile; see in_guard_band
  bool empty() const { return !(low[0] <= high[0] && low[1] <= high[1]); }
};

// One tile of the image.
struct ImageTile {
  int x0, y0, width, height;
  float low[2], high[2];              // bounds of its samples, in pixels of the undistorted camera
  std::vector<std::uint32_t> strips;  // strips that may be in the tile
};

class ImageTiling {
 public:
  // Both arguments must outlive this object.
  ImageTiling(const RasterMesh& mesh, const RowViews& views);

  bool bends() const { return bends_; }  // true for a camera with distortion

  // Makes the tiles of the image, for samples at the offsets (dx, dy) from the pixel centres. `rays`: rays of these
  // samples, for a camera with distortion. Parallel.
  void lay(double dx, double dy, const PixelRays& rays, std::vector<StripBox>& boxes,
           std::vector<ImageTile>& tiles) const;

  // Draws a tile's strips. `rays`, dx, dy and boxes as above.
  void draw(const ImageTile& tile, double dx, double dy, const PixelRays& rays, const std::vector<StripBox>& boxes,
            TileBuffer& buffer) const;

 private:
  bool moves() const { return !fits_.empty(); }  // true if rows have their own views
  TileView tile_view(const Mat2& a, const Vec2& b, int width, int height) const;
  TileView undistorted_view(double x0, double y0, int width, int height) const;
  Mat3 undistorted_map(double x0, double y0) const;
  TileView lens_view(const ImageTile& tile, const PixelRays& rays, TileBuffer& buffer, RowMotion& motion) const;
  void set_motion(const ImageTile& tile, const Mat3& map, TileView& view, RowMotion& motion) const;
  StripBox box_of(const Strip& strip, const TileView& image_view) const;
  const RowFit& fit_of(double row) const;
  std::optional<double> row_of(const Strip& strip, double dy) const;
  bool is_behind(const Strip& strip) const;
  StripBox moving_box_of(const Strip& strip, double dx, double dy, double lens_shift_px) const;
  double max_lens_shift_px(const PixelRays& rays) const;
  void bound(ImageTile& tile, const PixelRays& rays) const;

  const RasterMesh& mesh_;
  const RowViews& views_;
  const View& view_;
  const Camera& camera_;
  bool bends_;
  Vec3 eye_;  // of the reference view, m from the anchor
  bool is_far_;
  Vec3 pivot_;                // TileView::pivot of all tiles
  std::vector<RowFit> fits_;  // a fit per row of tiles; empty: all rows have the reference view
};

}  // namespace selenograph::engine
