#include "dem/detail/ground_maker.h"

#include <algorithm>
#include <cmath>

#include "dem/detail/direction_grid.h"
#include "dem/grid/shading_normals.h"

namespace selenograph::dem {
namespace {

// Returns a block's extent, enlarged by the surrounding posts from which normals and second differences are computed.
BlockExtent with_halo(const BlockExtent& e) {
  return {e.lat0 - kHalo * e.lat_step, e.lon0 - kHalo * e.lon_step, e.lat_step, e.lon_step, e.quads + 2 * kHalo};
}

// Interpolates between two layers. Returns one side's exact bits at shares 0 and 1: blocks outside the band of a border
// evaluate one layer only and must agree.
double mixed(double share, double below, double above) {
  return share == 0 ? below : share == 1 ? above : below + share * (above - below);
}

// Returns a factor of the albedo as Block::brightness has it. The darkest and the brightest ground of the Moon differ
// from the mean by less than these limits.
std::uint16_t encoded_brightness(double factor) {
  constexpr double kDarkest = 0.25, kBrightest = 3.5;
  return static_cast<std::uint16_t>(std::lround(std::clamp(factor, kDarkest, kBrightest) * double{kBrightnessOfOne}));
}

}  // namespace

// Interpolates a layer's posts (or, if the block is no finer than these, takes the pyramid's filtered ones), subtracts
// the mean correction and adds the detail.
GroundMaker::Surface GroundMaker::layer_surface(const BlockId& id, const BlockExtent& e,
                                                const LayeredPosts::Layer& layer, const StopToken& stop) const {
  const int side = e.quads + 1;
  const auto n = static_cast<std::size_t>(side);
  const bool finer = id.level > layer.level, shows_detail = id.level > layer.detail_level;
  PostReader posts(posts_, finer ? layer.level : id.level,
                   finer ? GroundPosts::Kind::of_layer : GroundPosts::Kind::filtered, stop);
  PostReader correction(posts_, layer.detail_level, GroundPosts::Kind::mean_correction, stop);
  Surface out{{}, std::vector<double>(n * n), std::vector<double>(n * n), {}, {}, 0};
  out.sources.reserve(n * n);
  std::vector<std::int64_t> lons;
  lons.reserve(n);
  for (int i = 0; i < side; ++i) lons.push_back(e.lon0 + std::int64_t{i} * e.lon_step);
  std::vector<double> correction_m(n);
  for (int r = 0; r < side; ++r) {
    stop.check();
    const std::int64_t lat = e.lat0 + std::int64_t{r} * e.lat_step;
    double* const row_m = out.heights_m.data() + static_cast<std::size_t>(r) * n;
    posts.interpolate_row(lat, lons, row_m);
    posts.append_sources(lat, lons, out.sources);
    if (!shows_detail) continue;
    correction.interpolate_row(lat, lons, correction_m.data());
    for (std::size_t c = 0; c < n; ++c) row_m[c] -= correction_m[c];
  }
  out.posts_m = out.heights_m;
  if (!finer) out.left_out_m = plain_.node(id, stop).error_m;
  out.ground.assign(n * n,
                    shows_detail && detail_.has_relief(id.level, layer.detail_level) ? Ground::relief : Ground::dem);
  if (!shows_detail) return out;
  std::vector<float> in_crater(n * n), on_clod(n * n), on_fragment(n * n);
  detail_.add(BlockDirections(e, 0, 1, side).grid(), id.level, layer.detail_level, out.heights_m,
              {in_crater, on_clod, {on_fragment, out.fragment_factor}}, stop, relief_factors(layer, e, stop));
  for (std::size_t post = 0; post < n * n; ++post) {
    if (in_crater[post] > 0) out.ground[post] = Ground::crater;
    if (on_clod[post] > 0) out.ground[post] = Ground::clod;
    if (on_fragment[post] > 0) out.ground[post] = Ground::rock;
  }
  // A level coarser than the posts omits, besides posts, the bicubic curve between them: double the plain error for it.
  out.left_out_m = 2 * out.left_out_m + detail_.left_out_m(id.level, layer.detail_level);
  return out;
}

std::vector<double> GroundMaker::shares(const LayeredPosts::Layer& layer, const BlockExtent& e) const {
  std::vector<double> shares;
  for (int r = 0; r <= e.quads; ++r)
    for (int c = 0; c <= e.quads; ++c) {
      // Wrap a position beyond a pole, in the halo, to the opposite meridian.
      double lat_deg = lat_deg_of(e.lat0 + r * e.lat_step), lon_deg = lon_deg_of(e.lon0 + c * e.lon_step);
      if (std::abs(lat_deg) > 90) {
        lat_deg = std::copysign(180, lat_deg) - lat_deg;
        lon_deg += 180;
      }
      shares.push_back(layers_.share(layer, lat_deg, lon_deg));
    }
  return shares;
}

// Blends a layer's ground over that of the coarser layers, by the layer's share at each post.
void GroundMaker::blend(Surface& below, const Surface& above, const BlockExtent& e,
                        const LayeredPosts::Layer& layer) const {
  const std::vector<double> shares_of_posts = shares(layer, e);
  for (std::size_t post = 0; post < shares_of_posts.size(); ++post) {
    const double share = shares_of_posts[post];
    if (share == 0) continue;
    double &posts_m = below.posts_m[post], &height_m = below.heights_m[post];
    const double detail_m = mixed(share, height_m - posts_m, above.heights_m[post] - above.posts_m[post]);
    posts_m = mixed(share, posts_m, above.posts_m[post]);
    height_m = share == 1 ? above.heights_m[post] : posts_m + detail_m;
    below.fragment_factor[post] = mixed(share, below.fragment_factor[post], above.fragment_factor[post]);
    if (share <= 0.5) continue;
    below.sources[post] = above.sources[post];
    below.ground[post] = above.ground[post];
  }
  below.left_out_m = std::max(below.left_out_m, above.left_out_m);
}

std::vector<double> GroundMaker::blended(const BlockId& id, const BlockExtent& e, double without_detail,
                                         const AddLayer& add) const {
  const int side = e.quads + 1;
  const BlockDirections directions(e, 0, 1, side);
  const auto n = static_cast<std::size_t>(side) * static_cast<std::size_t>(side);
  std::vector<double> values;
  const LayeredPosts::Layers layers = layers_.of(id);
  for (const LayeredPosts::Layer& layer : *layers) {
    std::vector<double> of_layer(n, without_detail);
    if (id.level > layer.detail_level) add(layer, directions.grid(), of_layer);
    if (&layer == &layers->front()) {
      values = std::move(of_layer);
      continue;
    }
    const std::vector<double> shares_of_posts = shares(layer, e);
    for (std::size_t post = 0; post < n; ++post)
      values[post] = mixed(shares_of_posts[post], values[post], of_layer[post]);
  }
  return values;
}

std::vector<double> GroundMaker::relief_factors(const LayeredPosts::Layer& layer, const BlockExtent& e,
                                                const StopToken& stop) const {
  std::vector<std::int64_t> lats, lons;
  for (int i = 0; i <= e.quads; ++i) {
    lats.push_back(e.lat0 + i * e.lat_step);
    lons.push_back(e.lon0 + i * e.lon_step);
  }
  return posts_.relief_factors(layer.detail_level, lats, lons, stop);
}

std::vector<double> GroundMaker::next_octave(const BlockId& id, const BlockExtent& e, const StopToken& stop) const {
  const int octave = Detail::smallest_octave(id.level) - 1;
  return blended(id, e, 0,
                 [&](const LayeredPosts::Layer& layer, const DirectionGrid& grid, std::span<double> heights_m) {
                   const bool follows_posts = detail_.relief().follows_posts(octave);
                   detail_.add_octave(grid, octave, heights_m, stop,
                                      follows_posts ? relief_factors(layer, e, stop) : std::vector<double>());
                 });
}

std::vector<double> GroundMaker::crater_brightness(const BlockId& id, const BlockExtent& e,
                                                   const StopToken& stop) const {
  if (detail_.brightness().none()) return {};
  return blended(id, e, 1, [&](const LayeredPosts::Layer& layer, const DirectionGrid& grid, std::span<double> factors) {
    detail_.add_crater_brightness(grid, id.level, layer.detail_level, factors, stop);
  });
}

GroundMaker::Surface GroundMaker::composed_surface(const BlockId& id, const BlockExtent& e,
                                                   const StopToken& stop) const {
  const LayeredPosts::Layers layers = layers_.of(id);
  Surface surface = layer_surface(id, e, layers->front(), stop);
  for (auto layer = layers->begin() + 1; layer != layers->end(); ++layer)
    blend(surface, layer_surface(id, e, *layer, stop), e, *layer);
  return surface;
}

std::shared_ptr<const Block> GroundMaker::heights(const BlockId& id, const BlockExtent& section,
                                                  const StopToken& stop) const {
  auto block = empty_block(id, section);
  for (const double height_m : composed_surface(id, section, stop).heights_m)
    block->vertices.push_back({static_cast<float>(height_m), Vec3f::zero()});
  return block;
}

// Evaluates the block with its halo; copies vertices, sources and ground; bounds the error by second differences.
std::shared_ptr<Block> GroundMaker::block(const BlockId& id, const StopToken& stop) const {
  auto block = empty_block(id, extent_of(id));
  const BlockExtent& e = block->extent;
  const auto n = static_cast<std::size_t>(e.quads + 1 + 2 * kHalo);
  const Surface surface = composed_surface(id, with_halo(e), stop);
  const bool everywhere = detail_.preset().region.everywhere();

  std::vector<float> rounded(surface.heights_m.begin(), surface.heights_m.end());
  block->vertices.reserve(block->index(e.quads, e.quads) + 1);
  block->sources.reserve(block->index(e.quads, e.quads) + 1);
  block->ground.reserve(block->index(e.quads, e.quads) + 1);
  float low = kHighestRelief_m, high = kLowestRelief_m;
  double bend_m = 0;  // largest second difference along rows and columns
  for (int r = 0; r <= e.quads; ++r)
    for (int c = 0; c <= e.quads; ++c) {
      const std::size_t post = static_cast<std::size_t>(r + kHalo) * n + static_cast<std::size_t>(c + kHalo);
      const float* h = rounded.data() + post;
      block->vertices.push_back({*h, Vec3f::zero()});
      block->sources.push_back(surface.sources[post]);
      // Relief fades inside the region. Craters, clods and fragments have their centres in it and may reach outside.
      const bool no_relief = !everywhere && surface.ground[post] == Ground::relief &&
                             detail_.share(block->position(r, c, 0).normalized()) == 0;
      block->ground.push_back(no_relief ? Ground::dem : surface.ground[post]);
      if (std::isnan(*h)) continue;
      low = std::min(low, *h);
      high = std::max(high, *h);
      for (const std::ptrdiff_t step : {std::ptrdiff_t{1}, static_cast<std::ptrdiff_t>(n)})
        if (const float second = h[step] - 2 * *h + h[-step]; !std::isnan(second))
          bend_m = std::max(bend_m, static_cast<double>(std::abs(second)));
    }
  if (low > high) return nullptr;
  const std::vector<double> factors = crater_brightness(id, e, stop);
  const auto side = static_cast<std::size_t>(block->side());
  for (std::size_t i = 0; i < factors.size(); ++i) {
    const std::size_t row = i / side, column = i % side;
    const double fragments = surface.fragment_factor[(row + kHalo) * n + column + kHalo];
    block->brightness.push_back(encoded_brightness(factors[i] + fragments));
  }
  block->pack();
  // A kink between two posts deviates from their chord by at most half the nearer post's second difference. Along two
  // axes, three quarters exceed every error that unit.detail has measured.
  block->error_m = 0.75 * bend_m + surface.left_out_m;
  block->min_m = low;
  block->max_m = high;
  const std::vector<double> next_octave_m = next_octave(id, with_halo(e), stop);
  const double base_m = std::round((double{low} + double{high}) / 2);
  for (std::size_t post = 0; post < rounded.size(); ++post)
    rounded[post] = static_cast<float>(surface.heights_m[post] - base_m + next_octave_m[post]);
  fill_shading_normals(*block, rounded, {.filtered = true, .base_m = base_m});
  return block;
}

}  // namespace selenograph::dem
