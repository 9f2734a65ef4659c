#include "engine/visibility/objects/rocks_in_view.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <tuple>
#include <unordered_set>
#include <utility>

#include "dem/base/parallel.h"
#include "dem/detail/detailed_terrain.h"
#include "dem/detail/footprints.h"
#include "dem/terrain/surface_place.h"
#include "engine/frame/needs.h"
#include "engine/scene/node_bounds.h"

namespace selenograph::engine {

int level_of_rocks(int octave) { return std::min(15 - octave, dem::kMaxLevel); }

double expected_rocks(const dem::RockField& field, int octave, const dem::Footprint& region, double smallest_m) {
  const double min_diameter_m = std::max({smallest_m, std::ldexp(1.0, octave), field.law().smallest_m});
  return dem::area_m2(region) * field.law().frequency.between(min_diameter_m, field.largest_m(octave));
}

namespace {

// Finds the rocks of a detail that a frame shows: first the blocks to search, then the rocks in them.
class RockSearch {
 public:
  RockSearch(const dem::Terrain& terrain, std::shared_ptr<dem::RockMemory> memory, const RowViews& views,
             const Sun* sun, const StopToken& stop)
      : terrain_(terrain), views_(views), survey_(terrain, std::move(memory)), stop_(stop) {
    if (!sun) return;
    constexpr double kMinElevationSine = 0.03;  // sine of the elevation of the Sun below which shadows are not followed
    toward_sun_ = sun->direction;
    min_elevation_sine_ = kMinElevationSine;
  }

  // Chooses the blocks of each octave in which rocks of at least min_px may be visible. Returns the expected number of
  // rocks in them.
  double choose_blocks(const std::vector<dem::BlockId>& blocks, double min_px) {
    min_px_ = min_px;
    chosen_ = {blocks.begin(), blocks.end()};
    auto octave_blocks =
        gathered_in_parallel<OctaveBlock>(blocks.size(), 64, [&](std::size_t i, std::vector<OctaveBlock>& out) {
          stop_.check();
          const dem::NodeInfo info = terrain_.node(blocks[i], stop_);
          if (!info.empty) add_octave_blocks(blocks[i], blocks[i].level, info, out);
        });
    std::sort(octave_blocks.begin(), octave_blocks.end(), [](const OctaveBlock& a, const OctaveBlock& b) {
      return std::tie(a.octave, a.block, a.smallest_m) < std::tie(b.octave, b.block, b.smallest_m);
    });
    octave_blocks.erase(std::unique(octave_blocks.begin(), octave_blocks.end(),
                                    [](const OctaveBlock& a, const OctaveBlock& b) { return same(a, b); }),
                        octave_blocks.end());
    octave_blocks_ = std::move(octave_blocks);
    const dem::RockField& field = survey_.field();
    double expected = 0;
    for (const OctaveBlock& octave_block : octave_blocks_)
      expected +=
          expected_rocks(field, octave_block.octave, dem::footprint_of(octave_block.block), octave_block.smallest_m);
    return expected;
  }

  // Returns the rocks in the chosen blocks, largest first; empty if they are more than kMaxRocks.
  std::optional<std::vector<dem::RockFeature>> find_rocks() const {
    auto rocks =
        gathered_in_parallel<dem::RockFeature>(octave_blocks_.size(), 4, kMaxRocks, [&](std::size_t i, auto& out) {
          stop_.check();
          const auto before = static_cast<std::ptrdiff_t>(out.size());
          survey_.add(octave_blocks_[i].octave, octave_blocks_[i].block, octave_blocks_[i].smallest_m, out, stop_);
          out.erase(std::remove_if(out.begin() + before, out.end(), [&](const auto& rock) { return !is_shown(rock); }),
                    out.end());
        });
    if (rocks) rocks = dem::largest_first(std::move(*rocks));
    return rocks;
  }

 private:
  // Block in which the rocks of an octave are searched. It may be wider than the blocks in view; rocks outside them are
  // dropped.
  struct OctaveBlock {
    int octave;
    dem::BlockId block;
    double smallest_m;
  };
  static bool same(const OctaveBlock& a, const OctaveBlock& b) { return a.octave == b.octave && a.block == b.block; }

  // Returns an upper bound of pixels per metre in a sub-block, over all views. A sub-block has the height range of its
  // parent, so it is bounded as a tall, narrow column, not only by its sphere.
  double pixels_per_metre(const NodeBounds& bounds) const {
    double max_px_per_m = 0;
    for (const ViewBundle& bundle : views_.bundles()) {
      const Vec3& camera = bundle.view.position();
      const Vec3 axis = bounds.centre.normalized(), camera_direction = camera.normalized();
      double half_width = 0;  // radius of the sub-block as a chord of directions from the centre of the Moon
      for (const Vec3& p : bounds.points) half_width = std::max(half_width, (p.normalized() - axis).norm());
      // Bound the distance from the camera to the column from below: by the distance to its nearest radial line, and by
      // the altitude of the camera above its top.
      //
      //        |column|         o camera
      //        |______|       .
      //          \    \     .         distance >= |camera| chord (1 - chord^2 / 4), where `chord` on the unit
      //           \    \  .           sphere is from the direction of the camera to the nearest of the column
      //            Moon centre
      const double chord = std::max(0.0, std::min(1.0, (camera_direction - axis).norm()) - 1.01 * half_width);
      const double nearest_m = std::max(camera.norm() * chord * (1 - chord * chord / 4),
                                        camera.norm() - kMoonRadius_m - bounds.high_m - bounds.bulge_m);
      max_px_per_m = std::max(max_px_per_m, std::min(bundle.pixels_per_metre_from(nearest_m),
                                                     bundle.pixels_per_metre(bounds.centre, bounds.radius_m)));
    }
    return max_px_per_m;
  }

  double pixels_per_metre(const Vec3& position) const {
    double max_px_per_m = 0;
    for (const ViewBundle& view : views_.bundles())
      max_px_per_m = std::max(max_px_per_m, view.pixels_per_metre(position, 0));
    return max_px_per_m;
  }

  bool may_be_in_view(std::span<const Vec3> points, double margin_m) const {
    return std::any_of(views_.bundles().begin(), views_.bundles().end(),
                       [&](const ViewBundle& view) { return view.may_see(points, margin_m); });
  }

  // Returns the length of the shadow of a rock on gently sloping ground.
  double shadow_m(const Vec3& position, double diameter_m) const {
    if (min_elevation_sine_ == 0) return 0;
    const double sine = toward_sun_.dot(position.normalized());
    return sine <= -min_elevation_sine_ ? 0 : diameter_m / std::max(min_elevation_sine_, sine);
  }

  // Adds the octave blocks for a chosen block or a sub-block of it, whose terrain lies between the heights of the
  // chosen block (`info`). Visits the sub-blocks while an octave needs finer ones.
  void add_octave_blocks(const dem::BlockId& id, int chosen_level, const dem::NodeInfo& info,
                         std::vector<OctaveBlock>& octave_blocks) {
    stop_.check();
    const dem::RockField& field = survey_.field();
    const NodeBounds bounds = bounds_of(id, static_cast<double>(info.min_m), static_cast<double>(info.max_m));
    const double smallest_m = min_px_ / pixels_per_metre(bounds);  // smallest rock that may be min_px_ wide
    if (!(field.law().largest_m >= smallest_m)) return;
    const auto may_show = [&](double largest_m) {
      return may_be_in_view(bounds.points, bounds.bulge_m + 2 * largest_m + shadow_m(bounds.centre, largest_m));
    };
    if (!may_show(field.law().largest_m)) return;
    bool has_finer_octaves = false;
    for (int octave = field.smallest_octave(); octave <= field.largest_octave(); ++octave) {
      if (field.largest_m(octave) < smallest_m) continue;
      const int level = level_of_rocks(octave);
      // Search an octave in blocks of its own level; a chosen block that is finer stands for its ancestor there.
      if (level == id.level || (level < id.level && id.level == chosen_level)) {
        if (may_show(field.largest_m(octave)))
          octave_blocks.push_back({octave, dem::ancestor_of(id, level), smallest_m});
      }
      has_finer_octaves |= level > id.level;
    }
    if (!has_finer_octaves) return;
    for (const dem::BlockId& child : dem::children_of(id)) add_octave_blocks(child, chosen_level, info, octave_blocks);
  }

  bool is_shown(const dem::RockFeature& rock) const {
    const double diameter_m = rock.rock.diameter_m;
    return diameter_m * pixels_per_metre(rock.position_m) >= min_px_ &&
           may_be_in_view({&rock.position_m, 1}, diameter_m + shadow_m(rock.position_m, diameter_m)) &&
           is_on_chosen_block(rock);
  }

  bool is_on_chosen_block(const dem::RockFeature& rock) const {
    const dem::Ticks at = dem::ticks_of(rock.location.lat_deg, rock.location.lon_deg);
    for (int level = dem::kMaxLevel; level >= 0; --level)
      if (chosen_.contains(at.block(level))) return true;
    return false;
  }

  const dem::Terrain& terrain_;
  const RowViews& views_;
  const dem::RockSurvey survey_;
  const StopToken& stop_;
  Vec3 toward_sun_ = Vec3::zero();
  double min_elevation_sine_ = 0;  // 0: shadows are ignored
  double min_px_ = 0;
  std::unordered_set<dem::BlockId, dem::BlockIdHash> chosen_;
  std::vector<OctaveBlock> octave_blocks_;
};

}  // namespace

RocksInView rocks_in_view(const dem::Terrain& terrain, std::shared_ptr<dem::RockMemory> memory, const RowViews& views,
                          const Sun* sun, const std::vector<dem::BlockId>& blocks, double max_error_px,
                          const StopToken& stop) {
  RocksInView found;
  if (!terrain.detailed() || terrain.detailed()->detail().rocks().empty()) return found;
  RockSearch search(terrain, std::move(memory), views, sun, stop);
  for (found.least_px = std::max(kMinRock_px, 2 * max_error_px);; found.least_px *= 2) {
    // Skip placing rocks on the ground if their expected number is far too large. The factor allows for octave blocks
    // that reach out of view.
    constexpr double kMaxExpectedFactor = 8;
    if (search.choose_blocks(blocks, found.least_px) > kMaxExpectedFactor * kMaxRocks) continue;
    auto rocks = search.find_rocks();
    if (!rocks) continue;
    found.rocks = std::move(*rocks);
    return found;
  }
}

void add_rocks(RocksInView from, RocksInView& to) {
  to.rocks.insert(to.rocks.end(), from.rocks.begin(), from.rocks.end());
  to.rocks = dem::largest_first(std::move(to.rocks));
  if (to.rocks.size() > kMaxRocks) to.rocks.resize(kMaxRocks);
  to.least_px = std::max(to.least_px, from.least_px);
}

}  // namespace selenograph::engine
