#include "engine/visibility/objects/rocks_in_view.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <tuple>
#include <unordered_set>
#include <utility>

#include "dem/base/parallel.h"
#include "dem/detail/detail.h"
#include "dem/detail/footprints.h"
#include "dem/terrain/surface_place.h"
#include "engine/frame/needs.h"
#include "engine/scene/node_bounds.h"

namespace selenograph::engine {

int level_of_rocks(int octave) { return std::min(15 - octave, dem::kMaxLevel); }

double expected_of(const dem::RockField& field, int octave, const dem::Footprint& region, double smallest_m) {
  const double least_m = std::max({smallest_m, std::ldexp(1.0, octave), field.law().smallest_m});
  return dem::area_m2(region) * field.law().frequency.between(least_m, field.largest_m(octave));
}

namespace {

class Finder {
 public:
  Finder(const dem::Terrain& terrain, std::shared_ptr<dem::RockMemory> memory, const RowViews& views, const Sun* sun,
         const StopToken& stop)
      : terrain_(terrain), views_(views), survey_(terrain, std::move(memory)), stop_(stop) {
    if (!sun) return;
    constexpr double kFlattest = 0.03;  // sine of the Sun's elevation, below which shadows aren't followed
    toward_sun_ = sun->direction, flattest_ = kFlattest;
  }

  // Where they may be that are at least so large; answers about how many there are.
  double look_for(const std::vector<dem::BlockId>& blocks, double least_px) {
    least_px_ = least_px;
    chosen_ = {blocks.begin(), blocks.end()};
    auto pieces = gathered_in_parallel<Piece>(blocks.size(), 64, [&](std::size_t i, std::vector<Piece>& some) {
      stop_.check();
      const dem::NodeInfo info = terrain_.node(blocks[i], stop_);
      if (!info.empty) look_into(blocks[i], blocks[i].level, info, some);
    });
    std::sort(pieces.begin(), pieces.end(), [](const Piece& a, const Piece& b) {
      return std::tie(a.octave, a.block, a.smallest_m) < std::tie(b.octave, b.block, b.smallest_m);
    });
    pieces.erase(std::unique(pieces.begin(), pieces.end(), [](const Piece& a, const Piece& b) { return same(a, b); }),
                 pieces.end());
    pieces_ = std::move(pieces);
    const dem::RockField& field = survey_.field();
    double expected = 0;
    for (const Piece& piece : pieces_)
      expected += expected_of(field, piece.octave, dem::footprint_of(piece.block), piece.smallest_m);
    return expected;
  }

  // The largest first; nothing where they are more than kMostRocks.
  std::optional<std::vector<dem::RockFeature>> found() const {
    auto rocks = gathered_in_parallel<dem::RockFeature>(pieces_.size(), 4, kMostRocks, [&](std::size_t i, auto& some) {
      stop_.check();
      const auto before = static_cast<std::ptrdiff_t>(some.size());
      survey_.add(pieces_[i].octave, pieces_[i].block, pieces_[i].smallest_m, some, stop_);
      some.erase(std::remove_if(some.begin() + before, some.end(), [&](const auto& rock) { return !shown(rock); }),
                 some.end());
    });
    if (rocks) rocks = dem::largest_first(std::move(*rocks));
    return rocks;
  }

 private:
  // May be wider than the blocks in view: rocks are few, and of them those in such blocks are taken.
  struct Piece {
    int octave;
    dem::BlockId block;
    double smallest_m;
  };
  static bool same(const Piece& a, const Piece& b) { return a.octave == b.octave && a.block == b.block; }

  // Of a part of a block: its terrain is a column, which may be much higher than wide.
  double pixels_per_metre(const NodeBounds& bounds) const {
    double most = 0;
    for (const ViewBundle& bundle : views_.bundles()) {
      const Vec3& camera = bundle.view.position();
      const Vec3 axis = bounds.centre.normalized(), toward = camera.normalized();
      double wide = 0;  // of directions from the Moon's centre
      for (const Vec3& p : bounds.points) wide = std::max(wide, (p.normalized() - axis).norm());
      // No nearer than the column is beside the camera, nor than it is beneath it.
      const double beside = std::max(0.0, std::min(1.0, (toward - axis).norm()) - 1.01 * wide);
      const double nearest_m = std::max(camera.norm() * beside * (1 - beside * beside / 4),
                                        camera.norm() - kMoonRadius_m - bounds.high_m - bounds.bulge_m);
      most = std::max(most, std::min(bundle.pixels_per_metre_from(nearest_m),
                                     bundle.pixels_per_metre(bounds.centre, bounds.radius_m)));
    }
    return most;
  }

  double pixels_per_metre(const Vec3& place) const {
    double most = 0;
    for (const ViewBundle& view : views_.bundles()) most = std::max(most, view.pixels_per_metre(place, 0));
    return most;
  }

  bool may_see(std::span<const Vec3> points, double margin_m) const {
    return std::any_of(views_.bundles().begin(), views_.bundles().end(),
                       [&](const ViewBundle& view) { return view.may_see(points, margin_m); });
  }

  // How far a rock's shadow reaches on ground that isn't steep.
  double shadow_m(const Vec3& place, double diameter_m) const {
    if (flattest_ == 0) return 0;
    const double sine = toward_sun_.dot(place.normalized());
    return sine <= -flattest_ ? 0 : diameter_m / std::max(flattest_, sine);
  }

  // A part of a chosen block, or all of it: its terrain lies between the block's heights.
  void look_into(const dem::BlockId& id, int chosen_level, const dem::NodeInfo& info, std::vector<Piece>& pieces) {
    stop_.check();
    const dem::RockField& field = survey_.field();
    const NodeBounds bounds = bounds_of(id, static_cast<double>(info.min_m), static_cast<double>(info.max_m));
    const double sharpest = pixels_per_metre(bounds), smallest_m = least_px_ / sharpest;
    if (!(field.law().largest_m >= smallest_m)) return;
    const auto near_view = [&](double largest_m) {
      return may_see(bounds.points, bounds.bulge_m + 2 * largest_m + shadow_m(bounds.centre, largest_m));
    };
    if (!near_view(field.law().largest_m)) return;
    bool finer = false;
    for (int k = field.smallest_octave(); k <= field.largest_octave(); ++k) {
      if (field.largest_m(k) < smallest_m) continue;
      const int level = level_of_rocks(k);
      if (level == id.level || (level < id.level && id.level == chosen_level)) {
        if (near_view(field.largest_m(k))) pieces.push_back({k, dem::ancestor_of(id, level), smallest_m});
      }
      finer |= level > id.level;
    }
    if (!finer) return;
    for (const dem::BlockId& child : dem::children_of(id)) look_into(child, chosen_level, info, pieces);
  }

  bool shown(const dem::RockFeature& rock) const {
    const double diameter_m = rock.rock.diameter_m;
    return diameter_m * pixels_per_metre(rock.position_m) >= least_px_ &&
           may_see({&rock.position_m, 1}, diameter_m + shadow_m(rock.position_m, diameter_m)) && on_chosen(rock);
  }

  bool on_chosen(const dem::RockFeature& rock) const {
    const dem::Ticks at = dem::ticks_of(rock.location.lat_deg, rock.location.lon_deg);
    for (int level = dem::kMaxLevel; level >= 0; --level)
      if (chosen_.contains(at.block(level))) return true;
    return false;
  }

  const dem::Terrain& terrain_;
  const RowViews& views_;
  const dem::RockSurvey survey_;
  const StopToken& stop_;
  Vec3 toward_sun_ = Vec3::Zero();
  double flattest_ = 0;  // 0: no shadows
  double least_px_ = 0;
  std::unordered_set<dem::BlockId, dem::BlockIdHash> chosen_;
  std::vector<Piece> pieces_;
};

}  // namespace

RocksInView rocks_in_view(const dem::Terrain& terrain, std::shared_ptr<dem::RockMemory> memory, const RowViews& views,
                          const Sun* sun, const std::vector<dem::BlockId>& blocks, double max_error_px,
                          const StopToken& stop) {
  RocksInView found;
  if (!terrain.detail() || terrain.detail()->rocks().empty()) return found;
  Finder finder(terrain, std::move(memory), views, sun, stop);
  for (found.least_px = std::max(kLeastRock_px, 2 * max_error_px);; found.least_px *= 2) {
    // Pieces reach beyond the view: far too many of theirs aren't put onto the ground to be counted.
    constexpr double kFarTooMany = 8;
    if (finder.look_for(blocks, found.least_px) > kFarTooMany * kMostRocks) continue;
    auto rocks = finder.found();
    if (!rocks) continue;
    found.rocks = std::move(*rocks);
    return found;
  }
}

void add_rocks(RocksInView from, RocksInView& to) {
  to.rocks.insert(to.rocks.end(), from.rocks.begin(), from.rocks.end());
  to.rocks = dem::largest_first(std::move(to.rocks));
  if (to.rocks.size() > kMostRocks) to.rocks.resize(kMostRocks);
  to.least_px = std::max(to.least_px, from.least_px);
}

}  // namespace selenograph::engine
