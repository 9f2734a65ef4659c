#include "dem/pyramid/block_posts.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "dem/grid/shading_normals.h"

namespace selenograph::dem {

Tick grid_lon_step(const BlockId& node, int level) {
  const BlockExtent e = extent_of(node);
  const Tick equatorward_lat = std::clamp(kLatTicks / 2, e.lat0, e.lat1() - 1);
  return extent_of(block_at(level, equatorward_lat, e.lon0)).lon_step;
}

PostsOfBlock compose_block(const BlockId& node, const BlockId& id, const PostSource& source, const StopToken& stop) {
  return compose_block(node, id, source, source.files(), stop);
}

PostsOfBlock compose_block(const BlockId& node, const BlockId& id, const PostSource& source, int files,
                           const StopToken& stop) {
  const BlockExtent e = extent_of(id);
  // Compose each longitude of the chunk's grid, even if the block uses every second one only: voids are then filled
  // exactly as in the chunk.
  const Tick lon_step = grid_lon_step(node, id.level);
  const int stride = steps_in(e.lon_step, lon_step), side = e.quads + 1;
  const auto window_with = [&](int margin) {
    PostWindow w;
    w.lat_step = e.lat_step;
    w.lon_step = lon_step;
    w.lat0 = e.lat0 - (kHalo + margin) * e.lat_step;
    w.lon0 = e.lon0 - (kHalo * stride + margin) * lon_step;
    w.rows = side + 2 * (kHalo + margin);
    w.cols = e.quads * stride + 1 + 2 * (kHalo * stride + margin);
    return w;
  };
  // Compose without the margin for filling first: most blocks have no voids.
  int margin = 0;
  PostWindow window = window_with(margin);
  Posts posts = source.compose(window, files, stop);
  if (std::any_of(posts.heights.begin(), posts.heights.end(), [](float h) { return std::isnan(h); })) {
    margin = kFillReach;
    window = window_with(margin);
    posts = source.compose(window, files, stop);
    PostSource::fill_voids(window, posts, stop);
  }
  PostsOfBlock out;
  out.replaced = std::move(posts.replaced);
  for (int r = 0; r < side + 2 * kHalo; ++r)
    for (int c = 0; c < side + 2 * kHalo; ++c) {
      const std::size_t post = static_cast<std::size_t>(r + margin) * static_cast<std::size_t>(window.cols) +
                               static_cast<std::size_t>(c * stride + margin);
      out.heights.push_back(posts.heights[post]);
      if (r >= kHalo && c >= kHalo && r < side + kHalo && c < side + kHalo) out.sources.push_back(posts.sources[post]);
    }
  return out;
}

}  // namespace selenograph::dem
