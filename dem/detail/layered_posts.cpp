#include "dem/detail/layered_posts.h"

#include <algorithm>
#include <cmath>

#include "dem/base/smoothstep.h"
#include "dem/detail/footprints.h"
#include "dem/grid/lattice.h"
#include "dem/grid/shading_normals.h"
#include "dem/posts/post_source.h"
#include "dem/terrain/surface_place.h"

namespace selenograph::dem {
namespace {

// Distance in posts by which a layer's ground extends past its outermost posts, up to the posts of its next file.
constexpr double kReachPosts = 2;

// Returns whether a position lies in a file's outline, which runs half a post outside its outermost posts.
bool inside(const RasterInfo& info, const PostXY& at) {
  return (info.wraps_longitude || (at.x >= -0.5 && at.x <= info.width - 0.5)) && at.y >= -0.5 &&
         at.y <= info.height - 0.5;
}

// Returns the distance of a position from a file's ground (its posts and kReachPosts around them), m; 0 on it.
double distance_m(const RasterInfo& info, const PostXY& at, double lat_deg) {
  double x = std::max({0.0, -at.x, at.x - (info.width - 1)});
  const double y = std::max({0.0, -at.y, at.y - (info.height - 1)});
  double x_m = info.post_spacing_m;  // spacing of columns
  if (const auto* g = std::get_if<GeographicGrid>(&info.grid)) {
    if (info.wraps_longitude) x = 0;
    x_m = kMetresPerDegree / g->lon_posts_per_degree * std::cos(lat_deg * kRadiansPerDegree);
  }
  return std::max(0.0, std::hypot(x * x_m, y * info.post_spacing_m) - kReachPosts * info.post_spacing_m);
}

// Returns the footprint of a block, enlarged by the surrounding posts that its surface and normals use.
Footprint footprint_with_halo(const BlockId& id) {
  const BlockExtent e = extent_of(id);
  Footprint box = footprint_of(id);
  constexpr double kDegreesPerTick = 1.0 / kTicksPerDegree;
  const double lat_deg = kDegreesPerTick * kHalo * e.lat_step, lon_deg = kDegreesPerTick * kHalo * e.lon_step;
  box.south_deg -= lat_deg;
  box.north_deg += lat_deg;
  box.west_deg -= lon_deg;
  box.east_deg += lon_deg;
  // Around a pole, all longitudes are near.
  if (box.south_deg < -90 || box.north_deg > 90) {
    box.west_deg = -180;
    box.east_deg = 180;
  }
  box.south_deg = std::max(box.south_deg, -90.0);
  box.north_deg = std::min(box.north_deg, 90.0);
  return box;
}

}  // namespace

// Finds, for each file, the level of its posts and the coarser level that its heights resolve.
LayeredPosts::LayeredPosts(const PyramidTerrain& plain, double widest_m) : plain_(plain), widest_m_(widest_m) {
  const Catalogue& catalogue = plain.catalogue();
  for (std::size_t i = 0; i < catalogue.rasters().size(); ++i) {
    const RasterInfo& info = catalogue.rasters()[i];
    // The lattice has no coarser blocks of posts than the roots.
    const int level = std::max(kRootLevel, level_needed(info));
    // The detail's level is as many octaves coarser as the file's resolved heights are than the level's posts, which
    // may be up to twice as dense as the file's.
    const double resolved_m = catalogue.resolved_posts(static_cast<int>(i)) * info.post_spacing_m;
    const auto octaves = static_cast<int>(std::lround(std::log2(resolved_m / post_spacing_m(level))));
    const int coarser = std::clamp(octaves, 0, std::max(0, level - kRootLevel));
    levels_of_files_.push_back({level, level - coarser});
    int& max_coarser = coarser_by_[static_cast<std::size_t>(level)];
    max_coarser = std::max(max_coarser, coarser);
  }
}

LayeredPosts::Layers LayeredPosts::of(const BlockId& id) const {
  if (plain_.catalogue().one_layer())
    return std::make_shared<const std::vector<Layer>>(1, layer_of(plain_.posts_level(id)));
  constexpr std::size_t kMaxBlocks = 20000;  // some 5 MB
  {
    const std::lock_guard lock(mutex_);
    if (const auto hit = layers_of_blocks_.find(id); hit != layers_of_blocks_.end()) return hit->second;
  }
  auto layers = std::make_shared<const std::vector<Layer>>(find_layers(id));
  const std::lock_guard lock(mutex_);
  if (layers_of_blocks_.size() >= kMaxBlocks) layers_of_blocks_.clear();
  return layers_of_blocks_.try_emplace(id, std::move(layers)).first->second;
}

int LayeredPosts::coarsest(const BlockId& id) const {
  return plain_.catalogue().one_layer() ? plain_.posts_level(id) : of(id)->front().level;
}

int LayeredPosts::coarsest_detail(const BlockId& id) const {
  if (plain_.catalogue().one_layer()) return layer_of(plain_.posts_level(id)).detail_level;
  const Layers layers = of(id);
  return std::min_element(layers->begin(), layers->end(),
                          [](const Layer& a, const Layer& b) { return a.detail_level < b.detail_level; })
      ->detail_level;
}

// Groups the files near a block by their levels, from coarse to fine; drops layers that finer ones cover entirely.
std::vector<LayeredPosts::Layer> LayeredPosts::find_layers(const BlockId& id) const {
  const Catalogue& catalogue = plain_.catalogue();
  // Include posts around the block, which the bicubic surface and the normals use.
  constexpr double kMarginPosts = 4;
  const Footprint search_box = around(footprint_of(id), widest_m_ + kMarginPosts * post_spacing_m(id.level));
  const auto levels_of = [&](int file) { return levels_of_files_[static_cast<std::size_t>(file)]; };
  const std::vector<int> near =
      catalogue.touching(search_box.south_deg, search_box.north_deg, search_box.west_deg, search_box.east_deg);
  if (near.empty()) return {layer_of(plain_.posts_level(id))};
  std::vector<Levels> levels;
  levels.reserve(near.size());
  for (const int file : near) levels.push_back(levels_of(file));
  std::sort(levels.begin(), levels.end());
  levels.erase(std::unique(levels.begin(), levels.end()), levels.end());

  const Footprint halo = footprint_with_halo(id);
  std::vector<Layer> layers{{levels.front().posts, levels.front().detail}};
  for (std::size_t k = 1; k < levels.size(); ++k) {
    Layer layer{levels[k].posts, levels[k].detail};
    layer.band_m = std::min(widest_m_, 2 * post_spacing_m(levels[k - 1].detail));
    for (const int file : near)
      if (levels_of(file) >= levels[k]) layer.files.push_back(file);
    // Drop the coarser layers if this one and the finer ones cover the block and its halo, sampled on 9 x 9 positions,
    // borders included.
    constexpr int kSamples = 9;
    bool covers = true;
    for (int r = 0; r < kSamples && covers; ++r)
      for (int c = 0; c < kSamples && covers; ++c)
        covers = share(layer, halo.south_deg + r * (halo.north_deg - halo.south_deg) / (kSamples - 1),
                       halo.west_deg + c * (halo.east_deg - halo.west_deg) / (kSamples - 1)) == 1;
    if (covers) {
      layers.clear();
      layer.files.clear();  // the coarsest layer has a share everywhere
    }
    layers.push_back(std::move(layer));
  }
  return layers;
}

double LayeredPosts::share(const Layer& layer, double lat_deg, double lon_deg) const {
  double nearest_m = layer.band_m;
  for (const int file : layer.files) {
    const RasterInfo& info = plain_.catalogue().rasters()[static_cast<std::size_t>(file)];
    const PostXY at = locate(info, lat_deg, lon_deg);
    if (inside(info, at)) return 1;
    nearest_m = std::min(nearest_m, distance_m(info, at, lat_deg));
  }
  return smoothstep(1 - nearest_m / layer.band_m);
}

LayeredPosts::RoughnessPosts LayeredPosts::roughness_posts(int detail_level) const {
  RoughnessPosts posts{detail_level};
  for (std::size_t file = 0; file < levels_of_files_.size(); ++file) {
    if (levels_of_files_[file].detail != detail_level) continue;
    posts.level = std::max(posts.level, levels_of_files_[file].posts);
    posts.quantisation_m = std::max(posts.quantisation_m, plain_.catalogue().rasters()[file].quantisation_m);
  }
  return posts;
}

int LayeredPosts::files_up_to(int level) const {
  // The catalogue sorts files from coarse to fine spacing, hence by the levels that they need.
  const auto& files = plain_.catalogue().rasters();
  const auto past = std::partition_point(files.begin(), files.end(),
                                         [&](const RasterInfo& file) { return level_needed(file) <= level; });
  return static_cast<int>(past - files.begin());
}

std::vector<DetailOfPosts> LayeredPosts::at(double lat_deg, double lon_deg) const {
  const BlockId id = block_at_place(plain_.posts_level(block_at_place(kMaxLevel, lat_deg, lon_deg)), lat_deg, lon_deg);
  std::vector<DetailOfPosts> found;
  const Layers layers = of(id);  // keeps the list alive if another thread clears the cache
  for (const Layer& layer : *layers) {
    const double share = found.empty() ? 1 : this->share(layer, lat_deg, lon_deg);
    for (DetailOfPosts& below : found) below.share *= 1 - share;
    found.push_back({layer.detail_level, share});
  }
  return found;
}

}  // namespace selenograph::dem
