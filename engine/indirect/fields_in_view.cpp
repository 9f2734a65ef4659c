#include "engine/indirect/fields_in_view.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>

#include "dem/base/parallel.h"
#include "dem/grid/lattice.h"
#include "dem/terrain/surface_place.h"
#include "engine/scene/node_bounds.h"

namespace selenograph::engine {
namespace {

// Returns false if a block is out of all views or below their horizon.
bool may_be_visible(const RowViews& views, const NodeBounds& bounds) {
  return std::any_of(views.bundles().begin(), views.bundles().end(), [&](const ViewBundle& view) {
    return view.may_see(bounds.centre, bounds.radius_m) && !below_horizon(view.view.position(), bounds, view.shift_m);
  });
}

// Returns false if an object or rock is out of all views.
bool may_be_visible(const RowViews& views, const Ball& ball) {
  return std::any_of(views.bundles().begin(), views.bundles().end(),
                     [&](const ViewBundle& from) { return from.may_see(ball.centre_m, ball.radius_m); });
}

// Returns the point of the ground below each view's camera.
std::vector<dem::Ticks> points_below_cameras(const RowViews& views) {
  std::vector<dem::Ticks> out;
  for (const ViewBundle& view : views.bundles()) {
    const Geographic g = to_geographic(view.view.position());
    out.push_back(dem::ticks_of(g.lat_deg, g.lon_deg));
  }
  return out;
}

// Returns the position (MOON_ME, m) of the block's post that is nearest to `place`, raised to the block's greatest
// height. If the block is on the opposite meridians, the way there leads over the pole, to its poleward row.
Vec3 nearest_post(const dem::Block& posts, const dem::Ticks& place) {
  const dem::BlockExtent& e = posts.extent;
  const double half_quads = e.quads / 2.0, quads = e.quads;
  // Ticks eastward from the block's middle meridian, -180 to 180 degrees.
  const double east =
      std::remainder(place.lon - (e.lon0 + half_quads * e.lon_step), static_cast<double>(dem::kLonTicks));
  const bool over_pole = std::abs(east) > dem::kLonTicks / 4.0;
  const double row = !over_pole ? (place.lat - e.lat0) / e.lat_step : e.lat0 < dem::kLatTicks / 2 ? 0 : quads;
  const auto to_post = [&](double posts_from_corner) {
    return static_cast<int>(std::lround(std::clamp(posts_from_corner, 0.0, quads)));
  };
  return posts.position(to_post(row), to_post(half_quads + east / e.lon_step), static_cast<double>(posts.max_m));
}

// Returns the distances at which pixels reach half of kLargestLitPixel_m and all of it.
Fade fade_of(const RowViews& views) {
  const double ends_m = kLargestLitPixel_m * views.reference().pixels_per_metre_from(1);
  return {views.reference().position(), ends_m / 2, ends_m};
}

struct BlockLevel {
  int level = -1;      // level of the posts of light; -1: its pixels are too large, or it is culled
  bool fades = false;  // part of it lies beyond Fade::begins_m
};

// Returns the level of posts of light with about this density. Levels differ by a factor of two in spacing: with the
// addition of 0.8, posts are 2^-0.8 to 2^0.2 (0.57 to 1.15) times as far apart as requested.
double level_of_light_posts(double posts_per_m) {
  return std::floor(std::log2(dem::post_spacing_m(0) * posts_per_m) + 0.8);
}

// Returns the level of a block's posts of light, from the view in which it needs the densest. `below_cameras`: see
// points_below_cameras(); `spacing_px`: pixels between posts.
BlockLevel level_for(const MeshBlock& block, const RowViews& views, std::span<const dem::Ticks> below_cameras,
                     const Fade& fade, double spacing_px) {
  const dem::Block& posts = *block.posts;
  const NodeBounds bounds = bounds_of(posts.id, static_cast<double>(posts.min_m), static_cast<double>(posts.max_m));
  if (!may_be_visible(views, bounds)) return {};
  double posts_per_m = 0, nearest_m = std::numeric_limits<double>::infinity(), farthest_m = 0;
  for (std::size_t i = 0; i < below_cameras.size(); ++i) {
    const ViewBundle& view = views.bundles()[i];
    const Vec3 post_m = nearest_post(posts, below_cameras[i]);
    const double pixels_per_metre = view.pixels_per_metre(post_m, 0);
    const double distance_m = (bounds.centre - view.view.position()).norm(), reach_m = bounds.radius_m + view.shift_m;
    nearest_m = std::min(nearest_m, distance_m - reach_m);
    farthest_m = std::max(farthest_m, distance_m + reach_m);
    // Keep the number of posts per area of the image on foreshortened ground.
    const double cos_emission = (view.view.position() - post_m).normalized().dot(post_m.normalized());
    posts_per_m =
        std::max(posts_per_m, pixels_per_metre / spacing_px * std::sqrt(std::clamp(cos_emission, 1.0 / 16, 1.0)));
  }
  if (nearest_m > fade.ends_m) return {};
  const int finest = posts.id.level + (spacing_px < 1 ? kCloser : 0);
  const double level = std::clamp<double>(level_of_light_posts(posts_per_m), posts.id.level - kCoarser, finest);
  return {std::max(kCoarsest, static_cast<int>(level)), farthest_m > fade.begins_m};
}

// On rough ground, light changes from post to post: its posts are up to kDenser times as close as spacing_px says, at
// least a pixel apart and no closer than the mesh's. kRough is that of the rougher half of a polar site at 5 m; smooth
// hillsides have half of it. Meshes of far views, all of which are rough, are not refined: those more than kMeshCoarser
// levels coarser than the terrain's posts.
constexpr double kRough = 0.014, kDenser = 4;
constexpr int kMeshCoarser = 1;
// Largest number of posts on refined ground, which fill 600 tiles; the roughest blocks are refined first.
constexpr double kMaxPostsOnRough = 1 << 17;

double spacing_on_rough_px(double spacing_px) { return std::min(spacing_px, std::max(spacing_px / kDenser, 1.0)); }

struct Roughness {
  double change = 0;  // RMS change of slope from post to post, halved; along the rougher axis
  double posts = 0;   // number of squares as high as the block's quads in its area
};

// Returns the roughness of a block. It needs all posts: a few crests make most of it.
Roughness roughness_of(const MeshBlock& block) {
  const dem::Block& posts = *block.posts;
  const int quads = posts.extent.quads;
  const auto height_m = [&](int row, int column) {
    return static_cast<double>(block.vertices[posts.index(row, column)].height_m);
  };
  const auto spacing_m = [&](int row, int column) {
    return (posts.position(row, column, 0) - posts.position(quads / 2, quads / 2, 0)).norm();
  };
  const double north_m = spacing_m(quads / 2 + 1, quads / 2), east_m = spacing_m(quads / 2, quads / 2 + 1);
  double north_sum = 0, east_sum = 0;
  int count = 0;
  for (int r = 1; r < quads; ++r)
    for (int c = 1; c < quads; ++c) {
      const double middle_m = height_m(r, c), north = height_m(r - 1, c) - 2 * middle_m + height_m(r + 1, c),
                   east = height_m(r, c - 1) - 2 * middle_m + height_m(r, c + 1);
      if (std::isnan(north + east)) continue;
      north_sum += north * north;
      east_sum += east * east;
      ++count;
    }
  if (count == 0) return {};
  return {std::max(std::sqrt(north_sum / count) / north_m, std::sqrt(east_sum / count) / east_m) / 2,
          quads * quads * east_m / north_m};
}

struct BlockLevels {
  std::vector<int> of_blocks;  // BlockLevel::level per block of the mesh
  bool fade = false;           // any ground in view is where light fades
};

// Returns the levels of the posts of light of all blocks, in parallel.
BlockLevels levels_of(const ViewOfGround& view, const dem::Terrain& terrain, const Fade& fade, double spacing_px) {
  const MeshBlocks blocks = view.mesh.blocks();
  const std::vector<dem::Ticks> below_cameras = points_below_cameras(view.views);
  BlockLevels out{std::vector<int>(blocks.size())};
  std::atomic<bool> fades = false;
  std::vector<Roughness> roughness(blocks.size());  // of ground that may be refined
  in_parallel_pieces(blocks.size(), 64, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t i = first; i < past_last; ++i) {
      const BlockLevel level = level_for(blocks[i], view.views, below_cameras, fade, spacing_px);
      out.of_blocks[i] = level.level;
      if (level.fades) fades = true;
      const dem::BlockId& id = blocks[i].posts->id;
      if (level.level >= 0 && level.level < id.level && terrain.posts_level(id) <= id.level + kMeshCoarser)
        roughness[i] = roughness_of(blocks[i]);
    }
  });
  out.fade = fades;
  std::vector<std::size_t> rough;  // indices of blocks
  for (std::size_t i = 0; i < blocks.size(); ++i)
    if (roughness[i].change > kRough) rough.push_back(i);
  std::stable_sort(rough.begin(), rough.end(),
                   [&](std::size_t a, std::size_t b) { return roughness[a].change > roughness[b].change; });
  double posts = 0;
  for (const std::size_t i : rough) {
    posts += roughness[i].posts;
    if (posts > kMaxPostsOnRough) break;
    out.of_blocks[i] = level_for(blocks[i], view.views, below_cameras, fade, spacing_on_rough_px(spacing_px)).level;
  }
  return out;
}

// Returns the field that lights an object over ground out of view. Its posts are as far apart as in view at the object,
// but no closer than 1/16 of the object's radius.
std::optional<LightField> field_below(const Ball& object, const RowViews& views, const dem::Terrain& terrain,
                                      const Fade& fade, double spacing_px) {
  constexpr double kPostsPerRadius = 16;
  if (!may_be_visible(views, object) || fade.share(object.centre_m) == 0) return std::nullopt;
  double posts_per_m = 0;
  for (const ViewBundle& view : views.bundles())
    posts_per_m = std::max(posts_per_m, view.pixels_per_metre(object.centre_m, 0) / spacing_px);
  const Geographic g = to_geographic(object.centre_m);
  const int finest = terrain.posts_level(dem::block_at_place(dem::kMaxLevel, g.lat_deg, g.lon_deg));
  const double level = level_of_light_posts(std::min(posts_per_m, kPostsPerRadius / object.radius_m));
  const int post_level = std::max(kCoarsest, static_cast<int>(std::clamp<double>(level, 0, finest)));
  return light_field_at(post_level, std::clamp(finest, post_level, post_level + kFiner), false, g.lat_deg, g.lon_deg);
}

// Collects the rows of a field's tiles that a frame needs.
class Marks {
 public:
  explicit Marks(const FieldPlane& plane)
      : side_(plane.tiles()),
        rows_(static_cast<std::size_t>(side_) * static_cast<std::size_t>(side_)),
        covered_(rows_.size()) {}

  // Corners of rectangles of the plane, in posts from the south-west (FieldPlane::posts_from_south_west). Rectangles
  // outside the field are clamped to its border.
  using Corner = Vec2;
  // Marks tiles that blocks of this field cover.
  void cover(const Corner& low_corner, const Corner& high_corner) {
    each_row(low_corner, high_corner, [&](std::size_t tile, int) { covered_[tile] = true; });
  }
  // Adds the posts around a rectangle.
  void add(const Corner& low_corner, const Corner& high_corner) {
    each_row(low_corner, high_corner, [&](std::size_t tile, int row) { mark(tile, row); });
  }
  // Adds the posts around a rectangle in covered tiles only: other fields light the rest.
  void add_covered(const Corner& low_corner, const Corner& high_corner) {
    each_row(low_corner, high_corner, [&](std::size_t tile, int row) {
      if (covered_[tile]) mark(tile, row);
    });
  }
  std::vector<TileRows> tiles() const {
    std::vector<TileRows> out;
    for (std::size_t t = 0; t < rows_.size(); ++t)
      if (rows_[t]) out.push_back({static_cast<int>(t), rows_[t]});
    return out;
  }

 private:
  // Calls visit(tile, row) for each row of quads that a rectangle touches, in each tile: `row` is counted in the tile.
  template <typename Visit>
  void each_row(const Corner& low_corner, const Corner& high_corner, const Visit& visit) const {
    constexpr int kQuads = FieldPlane::kTileQuads;
    const auto quad = [&](double posts) { return static_cast<int>(std::clamp<double>(posts, 0, side_ * kQuads - 1)); };
    for (int row = quad(low_corner.y()); row <= quad(high_corner.y()); ++row)
      for (int tile = quad(low_corner.x()) / kQuads; tile <= quad(high_corner.x()) / kQuads; ++tile)
        visit(static_cast<std::size_t>(row / kQuads * side_ + tile), row % kQuads);
  }
  // Adds the two rows of posts that bound a row of quads.
  void mark(std::size_t tile, int row) { rows_[tile] |= static_cast<std::uint16_t>(3U << row); }

  int side_;                         // tiles per side of the field
  std::vector<std::uint16_t> rows_;  // rows of posts per tile, a bit each; see TileRows
  std::vector<bool> covered_;        // tiles that blocks of this field cover
};

// A rectangle of a block's quads, culled as one.
struct QuadRect {
  int south, west, north, east;
};

// Extends a rectangle to the vertices onto which those of the block's border have collapsed: stitching moved them to
// every stride-th vertex of an edge.
QuadRect with_collapsed_border(QuadRect rect, const MeshBlock& block) {
  const int quads = block.side - 1;
  const auto widen = [](int& first, int& last, int stride) {
    first -= first % stride;
    last = (last + stride - 1) / stride * stride;
  };
  const std::array<int, 4>& stride = block.border.stride;
  if (rect.south == 0) widen(rect.west, rect.east, stride[0]);
  if (rect.north == quads) widen(rect.west, rect.east, stride[1]);
  if (rect.west == 0) widen(rect.south, rect.north, stride[2]);
  if (rect.east == quads) widen(rect.south, rect.north, stride[3]);
  return rect;
}

// Margin around ground: rocks up to this height may be in view while the ground below them is not.
constexpr double kTallestRock_m = 10;

// Returns the height range of a rectangle; low > high without data.
dem::HeightRange heights_of(const MeshBlock& block, const QuadRect& rect) {
  dem::HeightRange range{dem::kHighestRelief_m, dem::kLowestRelief_m};
  for (int r = rect.south; r <= rect.north; ++r)
    for (const dem::Vertex& v : block.vertices.subspan(block.posts->index(r, rect.west),
                                                       static_cast<std::size_t>(rect.east - rect.west + 1))) {
      range.low = v.height_m < range.low ? v.height_m : range.low;
      range.high = v.height_m > range.high ? v.height_m : range.high;
    }
  return range;
}

// Returns false if a rectangle of a block, enlarged by margin_m, is certainly out of view.
bool may_be_visible(const RowViews& views, const MeshBlock& block, const QuadRect& rect,
                    const dem::HeightRange& heights, double margin_m) {
  const dem::Block& posts = *block.posts;
  std::array<Vec3, 8> corners;
  std::size_t next = 0;
  for (const int row : {rect.south, rect.north})
    for (const int column : {rect.west, rect.east})
      for (const float height : {heights.low, heights.high})
        corners[next++] = posts.position(row, column, static_cast<double>(height));
  const Vec3 centre = posts.position((rect.south + rect.north) / 2, (rect.west + rect.east) / 2,
                                     static_cast<double>((heights.low + heights.high) / 2));
  double radius = 0;
  for (const Vec3& corner : corners) radius = std::max(radius, (corner - centre).norm());
  const NodeBounds bounds = bounds_around(centre, radius + margin_m);
  return std::any_of(views.bundles().begin(), views.bundles().end(), [&](const ViewBundle& view) {
    return view.may_see(centre, bounds.radius_m) && view.may_see(corners, margin_m) &&
           !below_horizon(view.view.position(), bounds, view.shift_m);
  });
}

// Marks the posts of light around a block's rectangles in view. A rectangle covers its tiles if it may be in view with
// the whole block's height range; its posts are added if it is so with its own.
void mark(const MeshBlock& block, const RowViews& views, const LightField& field, const FieldPlane& plane,
          Marks& marks) {
  const dem::Block& posts = *block.posts;
  // Rectangles are 4 x 4 posts of light in size, or 4 x 4 quads where posts of light are denser than the block's.
  const int quads = posts.extent.quads, size = std::min(quads, 4 << std::max(posts.id.level - field.level, 0));
  const dem::HeightRange block_heights{posts.min_m, posts.max_m};
  const double margin_m = plane.spacing_m();
  for (int r = 0; r < quads; r += size)
    for (int c = 0; c < quads; c += size) {
      const QuadRect rect = with_collapsed_border({r, c, std::min(r + size, quads), std::min(c + size, quads)}, block);
      if (!may_be_visible(views, block, rect, block_heights, std::max(margin_m, kTallestRock_m))) continue;
      Vec2 low_corner(1e9, 1e9), high_corner(-1e9, -1e9);
      for (const int row : {rect.south, rect.north})
        for (const int column : {rect.west, (rect.west + rect.east) / 2, rect.east}) {
          const Vec2 corner = plane.posts_from_south_west(posts.position(row, column, 0));
          low_corner = min_of(low_corner, corner);
          high_corner = max_of(high_corner, corner);
        }
      // Parallels bend by less than half a post between these corners.
      low_corner -= Vec2(0.5, 0.5);
      high_corner += Vec2(0.5, 0.5);
      marks.cover(low_corner, high_corner);
      const dem::HeightRange rect_heights = heights_of(block, rect);
      const bool has_data = rect_heights.low <= rect_heights.high;
      if (!has_data || !may_be_visible(views, block, rect, rect_heights, margin_m)) continue;
      marks.add(low_corner, high_corner);
    }
}

// Marks the posts of light below objects and rocks; for an object larger than many posts, those below its middle.
void mark_below(const ViewOfGround& view, const FieldPlane& plane, Marks& marks) {
  // Calls mark(low corner, high corner) for the square below each ball in view, at most `max_reach` posts from its
  // middle to a side.
  const auto for_each = [&](std::span<const Ball> balls, double max_reach, const auto& mark) {
    for (const Ball& ball : balls) {
      const double reach = std::min(ball.radius_m / plane.spacing_m() + 1, max_reach);
      const Vec2 centre = plane.posts_from_south_west(ball.centre_m),
                 from_middle = centre - Vec2(plane.middle(), plane.middle());
      // Skip objects on the other side of the Moon, which the plane does not show, and in other fields.
      const bool in_field = ball.centre_m.dot(plane.centre()) > 0 && from_middle.max_abs() - reach < plane.middle();
      if (in_field && may_be_visible(view.views, ball)) mark(centre - Vec2(reach, reach), centre + Vec2(reach, reach));
    }
  };
  constexpr double kMaxReachOfObject = 32;
  for_each(view.objects, kMaxReachOfObject,
           [&](const auto& low_corner, const auto& high_corner) { marks.add(low_corner, high_corner); });
  for_each(view.rocks, std::numeric_limits<double>::infinity(),
           [&](const auto& low_corner, const auto& high_corner) { marks.add_covered(low_corner, high_corner); });
}

}  // namespace

std::size_t FieldsInView::tiles() const {
  std::size_t sum = 0;
  for (const Field& field : fields) sum += field.tiles.size();
  return sum;
}

FieldsInView fields_in_view(const ViewOfGround& view, const dem::Terrain& terrain, double spacing_px) {
  const RowViews& views = view.views;
  const Mesh& mesh = view.mesh;
  constexpr LightField kNone{-1, 0, false, 0, 0};
  std::vector<LightField> of_blocks(mesh.blocks().size(), kNone);  // field of each block of the mesh
  const Fade fade = fade_of(views);
  const BlockLevels levels = levels_of(view, terrain, fade, spacing_px);
  bool fades = levels.fade;
  in_parallel_pieces(of_blocks.size(), 64, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t i = first; i < past_last; ++i) {
      const dem::Block& posts = *mesh.blocks()[i].posts;
      const int level = levels.of_blocks[i];
      if (level < 0) continue;
      const bool closer = level > posts.id.level;
      const int finest = closer ? level + kFiner : std::clamp(terrain.posts_level(posts.id), level, level + kFiner);
      const dem::BlockExtent& e = posts.extent;
      of_blocks[i] = light_field_at(level, finest, closer, dem::lat_deg_of(e.lat0 + e.quads / 2 * e.lat_step),
                                    dem::lon_deg_of(e.lon0 + e.quads / 2 * e.lon_step));
    }
  });
  std::vector<LightField> of_objects;
  of_objects.reserve(view.objects.size());
  for (const Ball& object : view.objects) {
    if (fade.share(object.centre_m) < 1) fades = true;
    const auto block_below = mesh.block_at(object.centre_m);
    of_objects.push_back(block_below && of_blocks[*block_below] != kNone
                             ? of_blocks[*block_below]
                             : field_below(object, views, terrain, fade, spacing_px).value_or(kNone));
  }
  // Number the different fields in ascending order, so that the result does not depend on threads. kNone, with level
  // -1, comes first and goes.
  std::vector<LightField> ids(of_blocks);
  ids.insert(ids.end(), of_objects.begin(), of_objects.end());
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
  if (!ids.empty() && ids.front() == kNone) ids.erase(ids.begin());
  FieldsInView out;
  if (fades) out.fade = fade;
  std::vector<std::vector<std::size_t>> blocks(ids.size());  // indices of each field's blocks
  const auto number_of = [&](const LightField& field) {
    return field == kNone ? -1 : static_cast<int>(std::lower_bound(ids.begin(), ids.end(), field) - ids.begin());
  };
  for (std::size_t i = 0; i < of_blocks.size(); ++i) {
    const int field = out.field_of_block.emplace_back(number_of(of_blocks[i]));
    if (field >= 0) blocks[static_cast<std::size_t>(field)].push_back(i);
  }
  for (const LightField& field : of_objects) out.field_of_object.push_back(number_of(field));
  for (const LightField& id : ids) out.fields.push_back({id, FieldPlane(id), {}});
  in_parallel(ids.size(), [&](std::size_t f) {
    FieldsInView::Field& field = out.fields[f];
    Marks marks(field.plane);
    for (const std::size_t i : blocks[f]) mark(mesh.blocks()[i], views, field.id, field.plane, marks);
    mark_below(view, field.plane, marks);
    field.tiles = marks.tiles();
  });
  return out;
}

}  // namespace selenograph::engine
