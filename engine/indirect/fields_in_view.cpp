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

bool may_see(const RowViews& views, const NodeBounds& bounds) {
  return std::any_of(views.bundles().begin(), views.bundles().end(), [&](const ViewBundle& view) {
    return view.may_see(bounds.centre, bounds.radius_m) && !below_horizon(view.view.position(), bounds, view.shift_m);
  });
}

bool may_see(const RowViews& views, const Ball& ball) {
  return std::any_of(views.bundles().begin(), views.bundles().end(),
                     [&](const ViewBundle& from) { return from.may_see(ball.centre_m, ball.radius_m); });
}

// Below each view's camera.
std::vector<dem::Ticks> places_below(const RowViews& views) {
  std::vector<dem::Ticks> out;
  for (const ViewBundle& view : views.bundles()) {
    const Geographic g = to_geographic(view.view.position());
    out.push_back(dem::ticks_of(g.lat_deg, g.lon_deg));
  }
  return out;
}

// The post of a block that is nearest to a place, at the height of the highest.
Vec3 nearest_post(const dem::Block& posts, const dem::Ticks& to) {
  const dem::BlockExtent& e = posts.extent;
  const double half = e.quads / 2.0, quads = e.quads;
  const double east = std::remainder(to.lon - (e.lon0 + half * e.lon_step), static_cast<double>(dem::kLonTicks));
  const bool over_pole = std::abs(east) > dem::kLonTicks / 4.0;
  const double row = !over_pole ? (to.lat - e.lat0) / e.lat_step : e.lat0 < dem::kLatTicks / 2 ? 0 : quads;
  const auto post = [&](double at) { return static_cast<int>(std::lround(std::clamp(at, 0.0, quads))); };
  return posts.position(post(row), post(half + east / e.lon_step), static_cast<double>(posts.max_m));
}

Fade fade_of(const RowViews& views) {
  const double ends_m = kLargestLitPixel_m * views.reference().pixels_per_metre_from(1);
  return {views.reference().position(), ends_m / 2, ends_m};
}

struct BlockLevel {
  int level = -1;      // of the posts of light; -1: its pixels are too large, or nobody sees it
  bool fades = false;  // some of it
};

// Levels differ by a factor of two: posts are 0.57 to 1.15 times as far apart as was asked for.
double level_of(double posts_per_m) { return std::floor(std::log2(dem::post_spacing_m(0) * posts_per_m) + 0.8); }

BlockLevel level_for(const MeshBlock& block, const RowViews& views, std::span<const dem::Ticks> below, const Fade& fade,
                     double spacing_px) {
  const dem::Block& posts = *block.posts;
  const NodeBounds bounds = bounds_of(posts.id, static_cast<double>(posts.min_m), static_cast<double>(posts.max_m));
  if (!may_see(views, bounds)) return {};
  double posts_per_m = 0, nearest_m = std::numeric_limits<double>::infinity(), farthest_m = 0;
  for (std::size_t i = 0; i < below.size(); ++i) {
    const ViewBundle& view = views.bundles()[i];
    const Vec3 place = nearest_post(posts, below[i]);
    const double here = view.pixels_per_metre(place, 0);
    const double away_m = (bounds.centre - view.view.position()).norm(), reach_m = bounds.radius_m + view.shift_m;
    nearest_m = std::min(nearest_m, away_m - reach_m);
    farthest_m = std::max(farthest_m, away_m + reach_m);
    // Foreshortened ground shows as many posts per area of the image as other ground.
    const double emission = (view.view.position() - place).normalized().dot(place.normalized());
    posts_per_m = std::max(posts_per_m, here / spacing_px * std::sqrt(std::clamp(emission, 1.0 / 16, 1.0)));
  }
  if (nearest_m > fade.ends_m) return {};
  const int finest = posts.id.level + (spacing_px < 1 ? kCloser : 0);
  return {std::max(kCoarsest,
                   static_cast<int>(std::clamp<double>(level_of(posts_per_m), posts.id.level - kCoarser, finest))),
          farthest_m > fade.begins_m};
}

// What lights an object over ground that nobody sees: posts as far apart as in view where it is, but no closer than a
// part of it.
std::optional<LightField> field_below(const Ball& object, const RowViews& views, const dem::Terrain& terrain,
                                      const Fade& fade, double spacing_px) {
  constexpr double kParts = 16;
  if (!may_see(views, object) || fade.share(object.centre_m) == 0) return std::nullopt;
  double posts_per_m = 0;
  for (const ViewBundle& view : views.bundles())
    posts_per_m = std::max(posts_per_m, view.pixels_per_metre(object.centre_m, 0) / spacing_px);
  const Geographic g = to_geographic(object.centre_m);
  const int finest = terrain.posts_level(dem::block_at_place(dem::kMaxLevel, g.lat_deg, g.lon_deg));
  const double level = level_of(std::min(posts_per_m, kParts / object.radius_m));
  const int own = std::max(kCoarsest, static_cast<int>(std::clamp<double>(level, 0, finest)));
  return light_field_at(own, std::clamp(finest, own, own + kFiner), false, g.lat_deg, g.lon_deg);
}

// Rows of a field's tiles.
class Marks {
 public:
  explicit Marks(const FieldPlane& plane)
      : side_(plane.tiles()),
        rows_(static_cast<std::size_t>(side_) * static_cast<std::size_t>(side_)),
        covered_(rows_.size()) {}

  // Rectangles of the plane; what is beside the field is at its border.
  using Corner = Eigen::Vector2d;
  // There are blocks of the field here.
  void cover(const Corner& least, const Corner& largest) {
    each_row(least, largest, [&](std::size_t tile, int) { covered_[tile] = true; });
  }
  // What places are between.
  void add(const Corner& least, const Corner& largest) {
    each_row(least, largest, [&](std::size_t tile, int row) { mark(tile, row); });
  }
  // The same, where there are blocks of the field: other fields light the rest.
  void add_covered(const Corner& least, const Corner& largest) {
    each_row(least, largest, [&](std::size_t tile, int row) {
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
  template <typename Each>
  void each_row(const Corner& least, const Corner& largest, const Each& each) const {
    constexpr int kQuads = FieldPlane::kTileQuads;
    const auto post = [&](double at) { return static_cast<int>(std::clamp<double>(at, 0, side_ * kQuads - 1)); };
    for (int row = post(least.y()); row <= post(largest.y()); ++row)
      for (int x = post(least.x()) / kQuads; x <= post(largest.x()) / kQuads; ++x)
        each(static_cast<std::size_t>(row / kQuads * side_ + x), row % kQuads);
  }
  void mark(std::size_t tile, int row) { rows_[tile] |= static_cast<std::uint16_t>(3U << row); }

  int side_;
  std::vector<std::uint16_t> rows_;
  std::vector<bool> covered_;
};

// Quads of a block that are looked at together.
struct Part {
  int south, west, north, east;
};

// With the vertices onto which those of the block's border have collapsed.
Part joined(Part part, const MeshBlock& block) {
  const int quads = block.side - 1;
  const auto widen = [](int& first, int& last, int stride) {
    first -= first % stride;
    last = (last + stride - 1) / stride * stride;
  };
  const std::array<int, 4>& stride = block.border.stride;
  if (part.south == 0) widen(part.west, part.east, stride[0]);
  if (part.north == quads) widen(part.west, part.east, stride[1]);
  if (part.west == 0) widen(part.south, part.north, stride[2]);
  if (part.east == quads) widen(part.south, part.north, stride[3]);
  return part;
}

// Rocks may be in view while the ground below them is beside it.
constexpr double kTallestRock_m = 10;

// low > high: none of it has data.
dem::HeightRange heights_of(const MeshBlock& block, const Part& part) {
  dem::HeightRange range{dem::kHighestRelief_m, dem::kLowestRelief_m};
  for (int r = part.south; r <= part.north; ++r)
    for (const dem::Vertex& v : block.vertices.subspan(block.posts->index(r, part.west),
                                                       static_cast<std::size_t>(part.east - part.west + 1))) {
      range.low = v.height_m < range.low ? v.height_m : range.low;
      range.high = v.height_m > range.high ? v.height_m : range.high;
    }
  return range;
}

// Whether anybody may see a part of a block, or a place at most `beside_m` from it.
bool may_see(const RowViews& views, const MeshBlock& block, const Part& part, const dem::HeightRange& heights,
             double beside_m) {
  const dem::Block& posts = *block.posts;
  std::array<Vec3, 8> corners;
  std::size_t next = 0;
  for (const int row : {part.south, part.north})
    for (const int column : {part.west, part.east})
      for (const float height : {heights.low, heights.high})
        corners[next++] = posts.position(row, column, static_cast<double>(height));
  const Vec3 centre = posts.position((part.south + part.north) / 2, (part.west + part.east) / 2,
                                     static_cast<double>((heights.low + heights.high) / 2));
  double radius = 0;
  for (const Vec3& corner : corners) radius = std::max(radius, (corner - centre).norm());
  const NodeBounds bounds = bounds_around(centre, radius + beside_m);
  return std::any_of(views.bundles().begin(), views.bundles().end(), [&](const ViewBundle& view) {
    return view.may_see(centre, bounds.radius_m) && view.may_see(corners, beside_m) &&
           !below_horizon(view.view.position(), bounds, view.shift_m);
  });
}

// Marks what a block's parts in view may be between: four posts of light each.
void mark(const MeshBlock& block, const RowViews& views, const LightField& field, const FieldPlane& plane,
          Marks& marks) {
  const dem::Block& posts = *block.posts;
  const int quads = posts.extent.quads, size = std::min(quads, 4 << std::max(posts.id.level - field.level, 0));
  const dem::HeightRange all{posts.min_m, posts.max_m};
  const double beside_m = plane.spacing_m();
  for (int r = 0; r < quads; r += size)
    for (int c = 0; c < quads; c += size) {
      const Part part = joined({r, c, std::min(r + size, quads), std::min(c + size, quads)}, block);
      if (!may_see(views, block, part, all, std::max(beside_m, kTallestRock_m))) continue;
      Eigen::Vector2d least(1e9, 1e9), largest(-1e9, -1e9);
      for (const int row : {part.south, part.north})
        for (const int column : {part.west, (part.west + part.east) / 2, part.east}) {
          const Eigen::Vector2d at = plane.place(posts.position(row, column, 0));
          least = least.cwiseMin(at);
          largest = largest.cwiseMax(at);
        }
      // Between these, parallels are bent by less than half a post.
      // Between these, parallels are bent by less than half a post.
      least.array() -= 0.5;
      largest.array() += 0.5;
      marks.cover(least, largest);
      const dem::HeightRange own = heights_of(block, part);
      if (own.low > own.high || !may_see(views, block, part, own, beside_m)) continue;
      marks.add(least, largest);
    }
}

// What is below objects and rocks; of an object that is larger than many posts, below its middle.
void mark_below(const ViewOfGround& view, const FieldPlane& plane, Marks& marks) {
  const auto each = [&](std::span<const Ball> balls, double farthest, const auto& mark) {
    for (const Ball& ball : balls) {
      const double reach = std::min(ball.radius_m / plane.spacing_m() + 1, farthest);
      const Eigen::Vector2d at = plane.place(ball.centre_m), from_middle = at.array() - plane.middle();
      // Else it is on the Moon's other side, or in other fields alone.
      const bool in_field =
          ball.centre_m.dot(plane.centre()) > 0 && from_middle.cwiseAbs().maxCoeff() - reach < plane.middle();
      if (in_field && may_see(view.views, ball)) mark(at.array() - reach, at.array() + reach);
    }
  };
  constexpr double kFarthest = 32;
  each(view.objects, kFarthest, [&](const auto& least, const auto& largest) { marks.add(least, largest); });
  each(view.rocks, std::numeric_limits<double>::infinity(),
       [&](const auto& least, const auto& largest) { marks.add_covered(least, largest); });
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
  std::vector<LightField> of_blocks(mesh.blocks().size(), kNone);
  const std::vector<dem::Ticks> below = places_below(views);
  const Fade fade = fade_of(views);
  std::atomic<bool> fades = false;
  in_parallel_pieces(of_blocks.size(), 64, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t i = first; i < past_last; ++i) {
      const dem::Block& posts = *mesh.blocks()[i].posts;
      const auto [level, block_fades] = level_for(mesh.blocks()[i], views, below, fade, spacing_px);
      if (level < 0) continue;
      if (block_fades) fades = true;
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
    const auto below_it = mesh.block_at(object.centre_m);
    of_objects.push_back(below_it && of_blocks[*below_it] != kNone
                             ? of_blocks[*below_it]
                             : field_below(object, views, terrain, fade, spacing_px).value_or(kNone));
  }
  std::vector<LightField> ids(of_blocks);
  ids.insert(ids.end(), of_objects.begin(), of_objects.end());
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
  if (!ids.empty() && ids.front() == kNone) ids.erase(ids.begin());
  FieldsInView out;
  if (fades) out.fade = fade;
  std::vector<std::vector<std::size_t>> blocks(ids.size());
  const auto number = [&](const LightField& field) {
    return field == kNone ? -1 : static_cast<int>(std::lower_bound(ids.begin(), ids.end(), field) - ids.begin());
  };
  for (std::size_t i = 0; i < of_blocks.size(); ++i) {
    const int of = out.of_block.emplace_back(number(of_blocks[i]));
    if (of >= 0) blocks[static_cast<std::size_t>(of)].push_back(i);
  }
  for (const LightField& field : of_objects) out.of_object.push_back(number(field));
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
