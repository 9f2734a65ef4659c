#include "engine/visibility/zbuffer/image_tiles.h"

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
// Sets `p` to one of the eight corners of the box, relative to the pivot: bit e of its number is the sign of the half
// axis e.
void place_corner(const Strip& s, int corner, const TileView& view, float* p) {
  for (int k = 0; k < 3; ++k) {
    p[k] = s.centre[k] - view.pivot[k];
    for (int e = 0; e < 3; ++e) p[k] += corner >> e & 1 ? s.half[e][k] : -s.half[e][k];
  }
}
Corner corner_of(const Strip& s, int corner, const TileView& view) {
  float p[3];
  place_corner(s, corner, view, p);
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

// Returns the greatest value of a quadratic polynomial, or a bound above it, within `reach` of 0.
float bound_of(float p0, float p1, float p2, float reach) { return p0 + reach * (std::abs(p1) + reach * std::abs(p2)); }

// Returns whether the box of a strip lies outside one side of a tile at all times of its rows. As outside_one_side, but
// the homogeneous coordinates of a corner are polynomials of the row.
bool outside_one_side_in_all_rows(const Strip& s, const TileView& t) {
  const RowMotion& motion = *t.motion;
  int outside[4] = {};  // corners left of the tile, right of it, above and below
  for (int corner = 0; corner < 8; ++corner) {
    float p[3];
    place_corner(s, corner, t, p);
    float column[3], line[3], depth[3];  // `line` is relative to the middle row
    for (int power = 0; power < 3; ++power) {
      const auto dot = [&](const float(&form)[3][4]) {
        return form[power][0] * p[0] + form[power][1] * p[1] + form[power][2] * p[2] + form[power][3];
      };
      column[power] = dot(motion.column);
      depth[power] = dot(motion.depth);
      line[power] = dot(motion.off_row) + (power > 0 ? depth[power - 1] : 0);
    }
    // Returns whether sign (v - at z) is negative at all times.
    const auto is_beyond = [&](const float* v, float at, float sign) {
      return bound_of(sign * (v[0] - at * depth[0]), v[1] - at * depth[1], v[2] - at * depth[2], motion.reach) < 0;
    };
    outside[0] += is_beyond(column, -1 - t.slack[0], 1);
    outside[1] += is_beyond(column, static_cast<float>(t.width) + t.slack[0], -1);
    outside[2] += is_beyond(line, -1 - t.slack[1] - motion.middle, 1);
    outside[3] += is_beyond(line, static_cast<float>(t.height) + t.slack[1] - motion.middle, -1);
  }
  return std::any_of(outside, outside + 4, [](int corners) { return corners == 8; });
}

// Sets the linear forms of a view, from those of homogeneous pixels.
void set_axes(const RowFit::Axes& pixels, TileView& view) {
  for (int k = 0; k < 3; ++k) {
    for (int i = 0; i < 3; ++i) view.row[k][i] = static_cast<float>(pixels.turn(k, i));
    view.offset[k] = static_cast<float>(pixels.shift[k]);
  }
}

static_assert(kTileHeight == kRowsOfBand, "each row of tiles has its own fit");

}  // namespace

// The eye is rounded to float as the pivot, and TileView::offset holds the difference.
ImageTiling::ImageTiling(const RasterMesh& mesh, const RowViews& views)
    : mesh_(mesh),
      views_(views),
      view_(views.reference()),
      camera_(view_.camera()),
      bends_(!camera_.rectilinear()),
      eye_(view_.position() - mesh.anchor()),
      is_far_(eye_.norm() > kFar_m),
      pivot_(is_far_ ? Vec3::zero() : eye_.cast<float>().cast<double>()) {
  if (!views.vary()) return;
  for (int band = 0; band * kTileHeight < views.height(); ++band)
    fits_.emplace_back(views, middle_of_band(band, views.height()), mesh.anchor() + pivot_);
}

// Returns the projection from points relative to the anchor to the pixels of a tile: pixel = a (x / z, y / z) + b, with
// the point (x, y, z) in camera axes.
TileView ImageTiling::tile_view(const Mat2& a, const Vec2& b, int width, int height) const {
  TileView t{};
  const Mat3 camera_from_moon = view_.moon_from_camera().transpose();
  const Vec3 x = camera_from_moon.row(0), y = camera_from_moon.row(1), z = camera_from_moon.row(2);
  const Vec3 rows[3] = {x * a(0, 0) + y * a(0, 1) + z * b.x(), x * a(1, 0) + y * a(1, 1) + z * b.y(), z};
  for (int k = 0; k < 3; ++k) {
    t.pivot[k] = static_cast<float>(pivot_[k]);
    for (int i = 0; i < 3; ++i) t.row[k][i] = static_cast<float>(rows[k][i]);
  }
  for (int k = 0; k < 3; ++k) t.offset[k] = static_cast<float>(rows[k].dot(pivot_ - eye_));
  t.near0 = is_far_ ? 0.F : 1.F;
  t.near1 = is_far_ ? 1.F : 0.F;
  t.width = width;
  t.height = height;
  t.min_depth_m = kNear_m;
  return t;
}

// Returns the view of a tile from (x0, y0) on, in pixels of the undistorted camera.
TileView ImageTiling::undistorted_view(double x0, double y0, int width, int height) const {
  return tile_view({{camera_.fx, 0}, {0, camera_.fy}}, {camera_.cx - x0, camera_.cy - y0}, width, height);
}

namespace {

// Returns the map from camera axes to homogeneous pixels: pixel = a (x / z, y / z) + b.
Mat3 pixel_map(const Mat2& a, const Vec2& b) {
  return {{a(0, 0), a(1, 0), 0}, {a(0, 1), a(1, 1), 0}, {b.x(), b.y(), 1}};
}

}  // namespace

// Returns the map from camera axes to homogeneous pixels of a tile from (x0, y0) on, in pixels of the undistorted
// camera.
Mat3 ImageTiling::undistorted_map(double x0, double y0) const {
  return pixel_map({{camera_.fx, 0}, {0, camera_.fy}}, {camera_.cx - x0, camera_.cy - y0});
}

// Sets how the view of a tile changes from row to row, if rows have their own views: to that of the fit's middle row,
// and its motion. `map`: from camera axes to homogeneous pixels of the tile.
void ImageTiling::set_motion(const ImageTile& tile, const Mat3& map, TileView& view, RowMotion& motion) const {
  if (!moves()) return;
  const RowFit& fit = fits_[static_cast<std::size_t>(tile.y0 / kTileHeight)];
  const int middle = fit.middle_row - tile.y0;
  RowFit::Axes previous;  // of the power below
  for (int power = 0; power < 3; ++power) {
    const RowFit::Axes pixels = map * fit.coefficients[static_cast<std::size_t>(power)];
    for (int i = 0; i < 4; ++i) {
      const Vec3& pixel = pixels.col(i);
      motion.column[power][i] = static_cast<float>(pixel.x());
      motion.off_row[power][i] = static_cast<float>(pixel.y() - middle * pixel.z() - previous.col(i).z());
      motion.depth[power][i] = static_cast<float>(pixel.z());
    }
    previous = pixels;
  }
  motion.middle = static_cast<float>(middle);
  motion.reach = static_cast<float>(std::max(std::abs(middle), std::abs(tile.height - middle)) + kBandMargin);
  set_axes(map * fit.coefficients[0], view);
  view.motion = &motion;
}

// Returns the view of a tile through a lens: the affine map that fits the lens at the tile's valid pixel nearest to its
// middle, and the position of each pixel's sample under that map. Without a valid pixel the view is empty.
TileView ImageTiling::lens_view(const ImageTile& tile, const PixelRays& rays, TileBuffer& buffer,
                                RowMotion& motion) const {
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
  if (valid_x < 0) return tile_view(Mat2::zero(), {0, 0}, 0, 0);
  const Vec2 middle(rays.x[image_index(valid_x, valid_y)], rays.y[image_index(valid_x, valid_y)]);
  const Mat2 jacobian = view_.projection().lens().jacobian(middle.x(), middle.y());
  const Mat2 pixel_from_slope = Mat2::from_rows(camera_.fx * jacobian.row(0), camera_.fy * jacobian.row(1));
  const Vec2 offset = Vec2(valid_x, valid_y) - pixel_from_slope * middle;
  TileView view = tile_view(pixel_from_slope, offset, tile.width, tile.height);
  set_motion(tile, pixel_map(pixel_from_slope, offset), view, motion);
  for (int y = 0; y < tile.height; ++y)
    for (int x = 0; x < tile.width; ++x) {
      const Vec2 p = pixel_from_slope * Vec2(rays.x[image_index(x, y)], rays.y[image_index(x, y)]) + offset;
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

// Returns the box of a strip in the image. Corners close to the eye or behind it make it unbounded.
StripBox ImageTiling::box_of(const Strip& s, const TileView& image_view) const {
  constexpr float kAnywhere = std::numeric_limits<float>::infinity();
  StripBox box{{kAnywhere, kAnywhere}, {-kAnywhere, -kAnywhere}, false};
  int corners_near = 0, corners_behind = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const Corner c = corner_of(s, corner, image_view);
    if (!(c.z > 2 * kNear_m)) {
      ++corners_near;
      corners_behind += c.z < -kNear_m ? 1 : 0;
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
  box.leaves_guard_band = corners_near > 0 || std::max({-box.low[0], -box.low[1], box.high[0], box.high[1]}) > max_px;
  for (int k = 0; k < 2; ++k) {
    if (corners_near > 0) {
      box.low[k] = -kAnywhere;
      box.high[k] = kAnywhere;
    }
    box.low[k] -= kSlack_px;
    box.high[k] += kSlack_px;
  }
  return box;
}

// Returns the row of the image, not rounded, in which a strip's middle is imaged, or the nearest row; empty if it is
// behind the camera. It need not be exact: moving_box_of bounds what is left.
std::optional<double> ImageTiling::row_of(const Strip& strip, double dy) const {
  constexpr int kSteps = 2;
  const double last_row = views_.height() - 1;
  const Vec3 middle = Vec3f(strip.centre).cast<double>() - pivot_;
  double row = last_row / 2;
  for (int step = 0; step < kSteps; ++step) {
    const Vec3 p = fit_of(row).at(row - fit_of(row).middle_row) * middle;
    if (!(p.z() > 0)) return std::nullopt;
    row = std::clamp(p.y() / p.z() * camera_.fy + camera_.cy - dy, 0.0, last_row);
  }
  return row;
}

// Returns whether a strip is behind the camera in all rows, by its depth in the middle row.
bool ImageTiling::is_behind(const Strip& strip) const {
  const auto vector = [](const float* v) -> Vec3 { return Vec3f(v).cast<double>(); };
  double radius_m = 0;
  for (const auto& half : strip.half) radius_m += vector(half).norm();
  const Vec3 from_eye = vector(strip.centre) - eye_;
  const RowViews::Step& step = views_.max_step();
  const double shift_m = step.shift_along_m + step.shift_across_m,
               turn_rad = step.turn_along_rad + step.turn_across_rad;
  const double change_m =
      views_.height() * (shift_m + turn_rad * (from_eye.norm() + radius_m + views_.height() * shift_m));
  return view_.moon_from_camera().col(2).dot(from_eye) + radius_m + change_m < 0;
}

const RowFit& ImageTiling::fit_of(double row) const {
  return fits_[static_cast<std::size_t>(row) / static_cast<std::size_t>(kTileHeight)];
}

// Returns the box of a strip in an image whose rows have their own views: its box at the time of one row, extended by
// the bound of its movement until the time of any row that images one of its vertices. If the image moves by v per row,
// a vertex at a distance D from the row moves to its own row in at most D / (1 - v) rows. A lens shifts rows.
StripBox ImageTiling::moving_box_of(const Strip& s, double dx, double dy, double lens_shift_px) const {
  constexpr float kAnywhere = std::numeric_limits<float>::infinity(), kMaxMoved_px = 512;
  constexpr double kMaxSpeed_px = 0.8;
  if (is_behind(s)) return {{kAnywhere, kAnywhere}, {-kAnywhere, -kAnywhere}, false};
  const std::optional<double> own_row = row_of(s, dy);
  if (!own_row) return {{-kAnywhere, -kAnywhere}, {kAnywhere, kAnywhere}, true};
  const double row = *own_row;
  const RowFit& fit = fit_of(row);
  TileView view = undistorted_view(dx, dy, camera_.width, camera_.height);
  set_axes(undistorted_map(dx, dy) * fit.at(row - fit.middle_row), view);
  float min_z = kAnywhere, max_z = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const float z = corner_of(s, corner, view).z;
    min_z = std::min(min_z, z);
    max_z = std::max(max_z, z);
  }
  StripBox box = box_of(s, view);
  if (!(min_z > 2 * kNear_m)) return box;  // out of view or unbounded
  // Bound the speed at the box's farthest corner from the principal point; a quarter more for its change in time.
  const auto slope_along = [&](int k, double centre, double focal) {
    const double low = static_cast<double>(box.low[k]) - centre, high = static_cast<double>(box.high[k]) - centre;
    return std::max(std::abs(low), std::abs(high)) / focal;
  };
  const double slope =
      std::hypot(slope_along(0, camera_.cx - dx, camera_.fx), slope_along(1, camera_.cy - dy, camera_.fy));
  const RowViews::Step& step = views_.max_step();
  const double depth_m = static_cast<double>(min_z);
  const double speed_px = 1.25 * stretched_focal_px(view_) * step.image_shift(depth_m, slope);
  const double distance_px = std::max(static_cast<double>(box.high[1]) - row, row - static_cast<double>(box.low[1]));
  const double rows = (distance_px + lens_shift_px) / (1 - speed_px);
  const auto moved_px = static_cast<float>(speed_px * rows);
  // A tile projects vertices beyond its rows at the time of a row up to kBandMargin away.
  const double max_rows = rows + 2 * kTileHeight + kBandMargin;
  const double depth_change_m =
      (step.shift_along_m + step.turn_across_rad * slope * static_cast<double>(max_z)) * max_rows;
  const bool is_slow =
      speed_px < kMaxSpeed_px && moved_px < kMaxMoved_px && depth_m > 2 * static_cast<double>(kNear_m) + depth_change_m;
  box.leaves_guard_band = box.leaves_guard_band || !is_slow;
  for (int k = 0; k < 2; ++k) {
    box.low[k] -= is_slow ? moved_px : kAnywhere;
    box.high[k] += is_slow ? moved_px : kAnywhere;
  }
  return box;
}

// Returns the largest distance, in rows, of a sample from its place in the undistorted camera.
double ImageTiling::max_lens_shift_px(const PixelRays& rays) const {
  std::vector<double> of_rows(static_cast<std::size_t>(camera_.height), 0);
  in_parallel_pieces(of_rows.size(), 64, [&](std::size_t first, std::size_t past_last) {
    const auto width = static_cast<std::size_t>(camera_.width);
    for (std::size_t y = first; y < past_last; ++y)
      for (std::size_t at = y * width; at < (y + 1) * width; ++at)
        if (!std::isnan(rays.y[at]))
          of_rows[y] = std::max(of_rows[y], std::abs(rays.y[at] * camera_.fy + camera_.cy - static_cast<double>(y)));
  });
  return *std::max_element(of_rows.begin(), of_rows.end());
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

// Bounds the strips in the image, then makes the tiles, a row of tiles per task. Through a lens, a tile is bounded by
// its samples' own positions, so that boxes must not be shifted by the samples' offset.
void ImageTiling::lay(double dx, double dy, const PixelRays& rays, std::vector<StripBox>& boxes,
                      std::vector<ImageTile>& tiles) const {
  const double box_dx = bends_ ? 0 : dx, box_dy = bends_ ? 0 : dy;
  const int width = camera_.width, height = camera_.height;
  const int tile_width = bends_ ? kLensTileSide : kTileWidth, tile_height = bends_ ? kLensTileSide : kTileHeight;
  const int tiles_across = (width + tile_width - 1) / tile_width;
  const int tiles_along = (height + tile_height - 1) / tile_height;
  const TileView image_view = undistorted_view(box_dx, box_dy, width, height);
  const double lens_shift_px = moves() && bends_ ? max_lens_shift_px(rays) : 0;
  boxes.resize(mesh_.strips().size());
  in_parallel_pieces(boxes.size(), 256, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t i = first; i < past_last; ++i)
      boxes[i] = moves() ? moving_box_of(mesh_.strips()[i], box_dx, box_dy, lens_shift_px)
                         : box_of(mesh_.strips()[i], image_view);
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

// Draws a tile. A box in the image is loose for a strip that leaves the guard band, through a lens, and if rows have
// their own views: test the strip against the tile itself there.
void ImageTiling::draw(const ImageTile& tile, double dx, double dy, const PixelRays& rays,
                       const std::vector<StripBox>& boxes, TileBuffer& buffer) const {
  RowMotion motion;
  TileView view = bends_ ? lens_view(tile, rays, buffer, motion)
                         : undistorted_view(tile.x0 + dx, tile.y0 + dy, tile.width, tile.height);
  if (!bends_) set_motion(tile, undistorted_map(tile.x0 + dx, tile.y0 + dy), view, motion);
  buffer.clear(tile.width, tile.height);
  for (const std::uint32_t s : tile.strips) {
    const Strip& strip = mesh_.strips()[s];
    const bool leaves = bends_ ? leaves_guard_band(strip, view) : boxes[s].leaves_guard_band;
    if (moves() ? outside_one_side_in_all_rows(strip, view) : (leaves || bends_) && outside_one_side(strip, view))
      continue;
    draw_strip(mesh_.blocks()[strip.block], strip, view, leaves, buffer);
  }
}

}  // namespace selenograph::engine
