#include "engine/visibility/zbuffer/image_tiles.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "dem/base/parallel.h"
#include "engine/support/packet.h"

namespace selenograph::engine {
namespace {

// Sizes of a tile in pixels. Tiles of a lens are smaller: the closer the lens is to an affine map, the fewer samples
// lie in the box of a triangle but not on it.
constexpr int kTileWidth = 128, kTileHeight = 64, kLensTileSide = 32;
static_assert(kTileWidth % kPacket == 0 && kLensTileSide % kPacket == 0, "lanes beyond a tile are beyond the image");

constexpr float kNear_m = 0.01F;    // depth of the near border of the guard band
constexpr double kFar_m = 500e3;    // distance of the eye from the anchor above which the anchor is the pivot
constexpr float kSlack_px = 0.05F;  // margin of the boxes of strips for rounding

// A corner of the box of a strip, homogeneous: x / z and y / z are its pixel.
struct Corner {
  float x, y, z;
};
// Returns one of the eight corners: bit e of its number is the sign of the half axis e.
Corner corner_of(const Strip& s, int corner, const TileView& view) {
  float p[3];
  for (int k = 0; k < 3; ++k) {
    p[k] = s.centre[k] - view.pivot[k];
    for (int e = 0; e < 3; ++e) p[k] += corner >> e & 1 ? s.half[e][k] : -s.half[e][k];
  }
  const auto dot = [&](int k) {
    return view.row[k][0] * p[0] + view.row[k][1] * p[1] + view.row[k][2] * p[2] + view.offset[k];
  };
  return {dot(0), dot(1), dot(2)};
}

// Returns whether the box of a strip lies outside one side of the tile. The comparisons are multiplied by z, so they
// hold for corners behind the eye.
bool outside_one_side(const Strip& s, const TileView& t) {
  int left = 0;
  int right = 0;
  int above = 0;
  int below = 0;
  const float before_x = -1 - t.slack[0];
  const float past_x = static_cast<float>(t.width) + t.slack[0];
  const float before_y = -1 - t.slack[1];
  const float past_y = static_cast<float>(t.height) + t.slack[1];
  for (int corner = 0; corner < 8; ++corner) {
    const auto [x, y, z] = corner_of(s, corner, t);
    left += x < before_x * z ? 1 : 0;
    right += x > past_x * z ? 1 : 0;
    above += y < before_y * z ? 1 : 0;
    below += y > past_y * z ? 1 : 0;
  }
  return left == 8 || right == 8 || above == 8 || below == 8;
}

// Returns whether vertices of a strip may lie outside the guard band of a tile. A tenth of the band and half of the
// minimum depth are reserved for rounding.
bool leaves_guard_band(const Strip& s, const TileView& t) {
  constexpr float kMax_px = 0.9F * kGuardBand_px;
  for (int corner = 0; corner < 8; ++corner) {
    const auto [x, y, z] = corner_of(s, corner, t);
    if (!(z > 2 * kNear_m && std::abs(x) <= kMax_px * z && std::abs(y) <= kMax_px * z)) return true;
  }
  return false;
}

}  // namespace

ImageTiling::ImageTiling(const RasterMesh& mesh, const View& view)
    : mesh_(mesh), view_(view), camera_(view.camera()), bends_(!view.camera().rectilinear()) {}

// Returns the projection from points relative to the anchor to the pixels of a tile: pixel = a (x / z, y / z) + b, with
// the point (x, y, z) in camera axes. The eye is rounded to float as the pivot, and `offset` holds the difference.
TileView ImageTiling::tile_view(const Eigen::Matrix2d& a, const Eigen::Vector2d& b, int width, int height) const {
  TileView t{};
  const Eigen::Matrix3d camera_from_moon = view_.moon_from_camera().transpose();
  const Vec3 eye = view_.position() - mesh_.anchor();
  const bool far = eye.norm() > kFar_m;
  const Vec3 x = camera_from_moon.row(0), y = camera_from_moon.row(1), z = camera_from_moon.row(2);
  const Vec3 rows[3] = {x * a(0, 0) + y * a(0, 1) + z * b.x(), x * a(1, 0) + y * a(1, 1) + z * b.y(), z};
  Vec3 pivot = Vec3::Zero();
  for (int k = 0; k < 3; ++k) {
    if (!far) pivot[k] = static_cast<double>(static_cast<float>(eye[k]));
    t.pivot[k] = static_cast<float>(pivot[k]);
    for (int i = 0; i < 3; ++i) t.row[k][i] = static_cast<float>(rows[k][i]);
  }
  for (int k = 0; k < 3; ++k) t.offset[k] = static_cast<float>(rows[k].dot(pivot - eye));
  t.near0 = far ? 0.F : 1.F;
  t.near1 = far ? 1.F : 0.F;
  t.width = width;
  t.height = height;
  t.min_depth_m = kNear_m;
  return t;
}

// Returns the view of a tile from (x0, y0) on, in pixels of the undistorted camera.
TileView ImageTiling::undistorted_view(double x0, double y0, int width, int height) const {
  return tile_view(Eigen::Vector2d(camera_.fx, camera_.fy).asDiagonal(), {camera_.cx - x0, camera_.cy - y0}, width,
                   height);
}

// Returns the view of a tile through a lens: the affine map that fits the lens at the tile's valid pixel nearest to its
// middle, and the position of each pixel's sample under that map. Without a valid pixel the view is empty.
TileView ImageTiling::lens_view(const ImageTile& tile, const PixelRays& rays, TileBuffer& buffer) const {
  const auto image_index = [&](int x, int y) {
    return static_cast<std::size_t>(tile.y0 + y) * static_cast<std::size_t>(camera_.width) +
           static_cast<std::size_t>(tile.x0 + x);
  };
  // Find the valid pixel nearest to the middle.
  int valid_x = -1;
  int valid_y = -1;
  int min_from_centre = std::numeric_limits<int>::max();
  for (int y = 0; y < tile.height; ++y)
    for (int x = 0; x < tile.width; ++x) {
      const int from_centre = std::abs(2 * x - tile.width) + std::abs(2 * y - tile.height);
      if (from_centre < min_from_centre && !std::isnan(rays.x[image_index(x, y)])) {
        valid_x = x;
        valid_y = y;
        min_from_centre = from_centre;
      }
    }
  const std::size_t n = static_cast<std::size_t>(tile.width) * static_cast<std::size_t>(tile.height);
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  buffer.sample_x.assign(n + kTilePadding, kNone);
  buffer.sample_y.assign(n + kTilePadding, kNone);
  if (valid_x < 0) return tile_view(Eigen::Matrix2d::Zero(), {0, 0}, 0, 0);
  const Eigen::Vector2d middle(rays.x[image_index(valid_x, valid_y)], rays.y[image_index(valid_x, valid_y)]);
  const Eigen::Matrix2d pixel_from_slope =
      Eigen::Vector2d(camera_.fx, camera_.fy).asDiagonal() * view_.projection().lens().jacobian(middle.x(), middle.y());
  const Eigen::Vector2d offset = Eigen::Vector2d(valid_x, valid_y) - pixel_from_slope * middle;
  TileView view = tile_view(pixel_from_slope, offset, tile.width, tile.height);
  for (int y = 0; y < tile.height; ++y)
    for (int x = 0; x < tile.width; ++x) {
      const Eigen::Vector2d p =
          pixel_from_slope * Eigen::Vector2d(rays.x[image_index(x, y)], rays.y[image_index(x, y)]) + offset;
      if (std::isnan(p.x())) continue;
      const std::size_t pixel =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(tile.width) + static_cast<std::size_t>(x);
      buffer.sample_x[pixel] = static_cast<float>(p.x());
      buffer.sample_y[pixel] = static_cast<float>(p.y());
      view.slack[0] = std::max(view.slack[0], std::abs(buffer.sample_x[pixel] - static_cast<float>(x)));
      view.slack[1] = std::max(view.slack[1], std::abs(buffer.sample_y[pixel] - static_cast<float>(y)));
    }
  view.sample_x = buffer.sample_x.data();
  view.sample_y = buffer.sample_y.data();
  return view;
}

// Returns the box of a strip in the image. Corners behind the eye make it unbounded.
StripBox ImageTiling::box_of(const Strip& s, const TileView& image_view) const {
  constexpr float kAnywhere = std::numeric_limits<float>::infinity();
  StripBox box{{kAnywhere, kAnywhere}, {-kAnywhere, -kAnywhere}, false};
  int corners_behind = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const Corner c = corner_of(s, corner, image_view);
    if (!(c.z > 2 * kNear_m)) {
      ++corners_behind;
      continue;
    }
    const float px[2] = {c.x / c.z, c.y / c.z};
    for (int k = 0; k < 2; ++k) {
      box.low[k] = std::min(box.low[k], px[k]);
      box.high[k] = std::max(box.high[k], px[k]);
    }
  }
  if (corners_behind == 8) return box;
  // Subtract the size of the image: a tile counts pixels from its own corner.
  const float max_px = 0.9F * kGuardBand_px - static_cast<float>(std::max(camera_.width, camera_.height));
  box.leaves_guard_band = corners_behind > 0 || std::max({-box.low[0], -box.low[1], box.high[0], box.high[1]}) > max_px;
  for (int k = 0; k < 2; ++k) {
    if (corners_behind > 0) {
      box.low[k] = -kAnywhere;
      box.high[k] = kAnywhere;
    }
    box.low[k] -= kSlack_px;
    box.high[k] += kSlack_px;
  }
  return box;
}

// Sets the bounds of the samples of a tile in pixels of the undistorted camera.
void ImageTiling::bound(ImageTile& tile, const PixelRays& rays) const {
  tile.low[0] = static_cast<float>(tile.x0);
  tile.high[0] = static_cast<float>(tile.x0 + tile.width - 1);
  tile.low[1] = static_cast<float>(tile.y0);
  tile.high[1] = static_cast<float>(tile.y0 + tile.height - 1);
  if (!bends_) return;
  tile.low[0] = tile.low[1] = std::numeric_limits<float>::infinity();
  tile.high[0] = tile.high[1] = -tile.low[0];
  for (int y = tile.y0; y < tile.y0 + tile.height; ++y)
    for (int x = tile.x0; x < tile.x0 + tile.width; ++x) {
      const std::size_t at =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(camera_.width) + static_cast<std::size_t>(x);
      if (std::isnan(rays.x[at])) continue;
      const float p[2] = {static_cast<float>(rays.x[at] * camera_.fx + camera_.cx),
                          static_cast<float>(rays.y[at] * camera_.fy + camera_.cy)};
      for (int k = 0; k < 2; ++k) {
        tile.low[k] = std::min(tile.low[k], p[k]);
        tile.high[k] = std::max(tile.high[k], p[k]);
      }
    }
}

// Bounds the strips in the image, then makes the tiles, a row of tiles per task.
void ImageTiling::lay(double dx, double dy, const PixelRays& rays, std::vector<StripBox>& boxes,
                      std::vector<ImageTile>& tiles) const {
  const int width = camera_.width, height = camera_.height;
  const int tile_width = bends_ ? kLensTileSide : kTileWidth, tile_height = bends_ ? kLensTileSide : kTileHeight;
  const int tiles_across = (width + tile_width - 1) / tile_width;
  const int tiles_along = (height + tile_height - 1) / tile_height;
  const TileView image_view = undistorted_view(dx, dy, width, height);
  boxes.resize(mesh_.strips().size());
  in_parallel_pieces(boxes.size(), 256, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t i = first; i < past_last; ++i) boxes[i] = box_of(mesh_.strips()[i], image_view);
  });
  tiles.resize(static_cast<std::size_t>(tiles_across) * static_cast<std::size_t>(tiles_along));
  in_parallel(static_cast<std::size_t>(tiles_along), [&](std::size_t row) {
    const auto row_tiles =
        std::span(tiles).subspan(row * static_cast<std::size_t>(tiles_across), static_cast<std::size_t>(tiles_across));
    float row_low = std::numeric_limits<float>::infinity();
    float row_high = -row_low;
    for (std::size_t column = 0; column < row_tiles.size(); ++column) {
      ImageTile& tile = row_tiles[column];
      tile.x0 = static_cast<int>(column) * tile_width;
      tile.y0 = static_cast<int>(row) * tile_height;
      tile.width = std::min(tile_width, width - tile.x0);
      tile.height = std::min(tile_height, height - tile.y0);
      tile.strips.clear();
      bound(tile, rays);
      row_low = std::min(row_low, tile.low[1]);
      row_high = std::max(row_high, tile.high[1]);
    }
    // Assign each strip to the tiles of this row that its box overlaps.
    for (std::size_t i = 0; i < boxes.size(); ++i) {
      const StripBox& box = boxes[i];
      if (box.empty() || box.high[1] < row_low || box.low[1] > row_high) continue;
      for (ImageTile& tile : row_tiles)
        if (box.low[0] <= tile.high[0] && box.high[0] >= tile.low[0] && box.low[1] <= tile.high[1] &&
            box.high[1] >= tile.low[1])
          tile.strips.push_back(static_cast<std::uint32_t>(i));
    }
  });
}

// Draws a tile. A box in the image is loose for a strip that leaves the guard band, and through a lens: test the strip
// against the tile itself there.
void ImageTiling::draw(const ImageTile& tile, double dx, double dy, const PixelRays& rays,
                       const std::vector<StripBox>& boxes, TileBuffer& buffer) const {
  const TileView view =
      bends_ ? lens_view(tile, rays, buffer) : undistorted_view(tile.x0 + dx, tile.y0 + dy, tile.width, tile.height);
  buffer.clear(tile.width, tile.height);
  for (const std::uint32_t s : tile.strips) {
    const Strip& strip = mesh_.strips()[s];
    const bool leaves = bends_ ? leaves_guard_band(strip, view) : boxes[s].leaves_guard_band;
    if ((leaves || bends_) && outside_one_side(strip, view)) continue;
    draw_strip(mesh_.blocks()[strip.block], strip, view, leaves, buffer);
  }
}

}  // namespace selenograph::engine
