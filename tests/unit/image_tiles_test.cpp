// Tiles of the image, with and without distortion: the strips that a tile lists are all that it shows.
#include "engine/visibility/zbuffer/image_tiles.h"

#include <gtest/gtest.h>

#include <numeric>
#include <random>
#include <vector>

#include "tests/support/sphere_mesh.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

class ImageTiles : public test::SphereMesh {
 protected:
  // Expects each tile to show the same triangles whether its own strips are drawn or all of the mesh, for samples at
  // these offsets from the pixel centres.
  static void expect_no_strip_missing(const RasterMesh& raster, const RowViews& views, double dx, double dy) {
    const Camera& camera = views.camera();
    const PixelRays lens = camera.rectilinear() ? PixelRays() : PixelRays(camera, dx, dy);
    const ImageTiling tiling(raster, views);
    std::vector<StripBox> boxes;
    std::vector<ImageTile> tiles;
    tiling.lay(dx, dy, lens, boxes, tiles);
    for (ImageTile& tile : tiles) {
      TileBuffer listed;
      tiling.draw(tile, dx, dy, lens, boxes, listed);
      tile.strips.resize(raster.strips().size());
      std::iota(tile.strips.begin(), tile.strips.end(), 0U);
      TileBuffer all;
      tiling.draw(tile, dx, dy, lens, boxes, all);
      EXPECT_EQ(listed.triangle, all.triangle)
          << "tile at " << tile.x0 << ", " << tile.y0 << ", samples at " << dx << ", " << dy;
    }
  }
};

TEST_F(ImageTiles, ListEveryStripOfTheirSamples) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> any(-1, 1);
  Camera camera = test::square_camera(200, 12);
  for (const double k1 : {0.0, 0.15, -0.15}) {
    camera.distortion.k1 = k1;
    for (int i = 0; i < 60; ++i) {
      const Vec3 ground = place_on(TriangleId(0, 60, 60, false), any(random), any(random));
      const Vec3 eye = ground * 1.4 + Vec3(any(random), any(random), any(random)) * 1e5;
      const RowViews views(camera, test::looking(eye, ground - eye, Vec3(any(random), any(random), 1)), std::nullopt);
      const RasterMesh raster(mesh(), ground);
      for (const double offset : {-0.5, 0.0, 0.49}) expect_no_strip_missing(raster, views, offset, -offset);
    }
  }
}

}  // namespace
}  // namespace selenograph::engine
