#include "engine/indirect/fields_in_view.h"

#include <algorithm>
#include <cmath>

#include "dem/grid/lattice.h"
#include "dem/support/parallel.h"
#include "engine/scene/node_bounds.h"

namespace selenograph::engine {
namespace {

bool may_see(const RowViews& views, const NodeBounds& bounds) {
  return std::any_of(views.bundles().begin(), views.bundles().end(), [&](const ViewBundle& view) {
    return view.may_see(bounds.centre, bounds.radius_m) && !below_horizon(view.view.position(), bounds, view.shift_m);
  });
}

// The level of the posts for a block in view; -1 where its pixels are too large, or nobody sees it.
int level_for(const MeshBlock& block, const RowViews& views, double spacing_px) {
  const dem::BlockId& id = block.posts->id;
  const NodeBounds bounds =
      bounds_of(id, static_cast<double>(block.posts->min_m), static_cast<double>(block.posts->max_m));
  if (!may_see(views, bounds)) return -1;
  double pixels_per_m = 0, posts_per_m = 0;
  for (const ViewBundle& view : views.bundles()) {
    const double here = view.pixels_per_metre(bounds.centre, bounds.radius_m);
    pixels_per_m = std::max(pixels_per_m, here);
    // Foreshortened ground shows as many posts per area of the image as other ground.
    const Vec3 toward = view.view.position() - bounds.centre;
    const double emission = toward.normalized().dot(bounds.centre.normalized()) + bounds.radius_m / toward.norm();
    posts_per_m = std::max(posts_per_m, here / spacing_px * std::sqrt(std::clamp(emission, 1.0 / 16, 1.0)));
  }
  if (!(pixels_per_m * kLargestLitPixel_m >= 1)) return -1;
  const double level = std::floor(std::log2(dem::post_spacing_m(0) * posts_per_m));
  return std::max(dem::kRootLevel, static_cast<int>(std::clamp<double>(level, id.level - kFiner, id.level)));
}

// Marks the tiles of which a block's parts in view may be.
void mark(const MeshBlock& block, const RowViews& views, const LightField& field, const FieldPlane& plane,
          std::vector<char>& marks) {
  const dem::Block& posts = *block.posts;
  const int quads = posts.extent.quads;
  const int part = std::min(quads, 8 << (posts.id.level - field.level));  // eight posts of light
  const double low = static_cast<double>(posts.min_m), high = static_cast<double>(posts.max_m);
  for (int r = 0; r < quads; r += part)
    for (int c = 0; c < quads; c += part) {
      const int north = std::min(r + part, quads), east = std::min(c + part, quads);
      const Vec3 centre = posts.position((r + north) / 2, (c + east) / 2, (low + high) / 2);
      double radius = 0;
      Eigen::Vector2d least(1e9, 1e9), largest(-1e9, -1e9);
      for (const int row : {r, north})
        for (const int column : {c, east})
          for (const double height : {low, high}) {
            const Vec3 corner = posts.position(row, column, height);
            radius = std::max(radius, (corner - centre).norm());
            const Eigen::Vector2d at = plane.place(corner);
            least = least.cwiseMin(at), largest = largest.cwiseMax(at);
          }
      if (!may_see(views, bounds_around(centre, radius))) continue;
      const auto tile = [&](double at) {
        return std::clamp(static_cast<int>(std::floor(at / FieldPlane::kTileQuads)), 0, plane.tiles() - 1);
      };
      // Parallels are bent by less than a post.
      for (int y = tile(least.y() - 1); y <= tile(largest.y() + 1); ++y)
        for (int x = tile(least.x() - 1); x <= tile(largest.x() + 1); ++x)
          marks[static_cast<std::size_t>(y * plane.tiles() + x)] = 1;
    }
}

}  // namespace

std::size_t FieldsInView::tiles() const {
  std::size_t sum = 0;
  for (const Field& field : fields) sum += field.tiles.size();
  return sum;
}

FieldsInView fields_in_view(const Mesh& mesh, const RowViews& views, const dem::Terrain& terrain, double spacing_px) {
  constexpr LightField kNone{-1, 0, 0, 0};
  std::vector<LightField> of_blocks(mesh.blocks().size(), kNone);
  in_parallel_pieces(of_blocks.size(), 64, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t i = first; i < past_last; ++i) {
      const dem::Block& posts = *mesh.blocks()[i].posts;
      const int level = level_for(mesh.blocks()[i], views, spacing_px);
      if (level < 0) continue;
      const dem::BlockExtent& e = posts.extent;
      of_blocks[i] = light_field_at(level, std::clamp(terrain.posts_level(posts.id), level, level + kFiner),
                                    dem::lat_deg_of(e.lat0 + e.quads / 2 * e.lat_step),
                                    dem::lon_deg_of(e.lon0 + e.quads / 2 * e.lon_step));
    }
  });
  std::vector<LightField> ids(of_blocks);
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
  if (!ids.empty() && ids.front() == kNone) ids.erase(ids.begin());
  FieldsInView out;
  std::vector<std::vector<std::size_t>> blocks(ids.size());
  for (std::size_t i = 0; i < of_blocks.size(); ++i) {
    const auto found = std::lower_bound(ids.begin(), ids.end(), of_blocks[i]);
    const bool none = of_blocks[i] == kNone;
    out.of_block.push_back(none ? -1 : static_cast<int>(found - ids.begin()));
    if (!none) blocks[static_cast<std::size_t>(found - ids.begin())].push_back(i);
  }
  for (const LightField& id : ids) out.fields.push_back({id, FieldPlane(id), {}});
  in_parallel(ids.size(), [&](std::size_t f) {
    FieldsInView::Field& field = out.fields[f];
    std::vector<char> marks(static_cast<std::size_t>(field.plane.tiles()) *
                            static_cast<std::size_t>(field.plane.tiles()));
    for (const std::size_t i : blocks[f]) mark(mesh.blocks()[i], views, field.id, field.plane, marks);
    for (std::size_t t = 0; t < marks.size(); ++t)
      if (marks[t]) field.tiles.push_back(static_cast<int>(t));
  });
  return out;
}

}  // namespace selenograph::engine
