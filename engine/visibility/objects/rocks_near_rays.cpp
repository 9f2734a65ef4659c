#include "engine/visibility/objects/rocks_near_rays.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <iterator>

#include "dem/base/parallel.h"
#include "dem/detail/footprints.h"
#include "dem/grid/geodesy.h"
#include "engine/frame/needs.h"
#include "engine/scene/node_bounds.h"
#include "engine/visibility/objects/rocks_in_view.h"

namespace selenograph::engine {
namespace {

// Where more rays than that pass a block, all of its rocks are looked for at once.
constexpr std::size_t kFewRays = 16;
constexpr double kLength = 4;  // of the parts of a ray that are looked around at once, in diameters

// From where to where along a ray.
struct Stretch {
  double from_m, to_m;
};

// Where the straight line of a ray is nearest to the Moon's middle.
double lowest_at(const RayCone& ray) { return -ray.origin_m.dot(ray.direction); }

// Squared; from there to where it is at a height. Negative: it never is.
double half_chord2(const RayCone& ray, double height_m) {
  const double radius = kMoonRadius_m + height_m;
  const double along = lowest_at(ray);
  return radius * radius - (ray.origin_m + along * ray.direction).squaredNorm();
}

// Within the ball around a block, where the ray is no higher than its terrain, or so far above that.
std::optional<Stretch> stretch_over(const RayCone& ray, const NodeBounds& b, double above_m) {
  const Vec3 to = b.centre - ray.origin_m;
  const double along = to.dot(ray.direction);
  const double reach = b.radius_m + above_m;
  const double ball = reach * reach - (to - along * ray.direction).squaredNorm();
  const double low = half_chord2(ray, b.high_m + b.bulge_m + 1 + above_m);
  if (ball < 0 || low < 0) return std::nullopt;
  const Stretch found{std::max({0.0, along - std::sqrt(ball), lowest_at(ray) - std::sqrt(low)}),
                      std::min(along + std::sqrt(ball), lowest_at(ray) + std::sqrt(low))};
  return found.from_m <= found.to_m ? std::optional(found) : std::nullopt;
}

// What is left of it where the ray doesn't come back from below a height.
Stretch until_below(const RayCone& ray, Stretch stretch, double height_m) {
  if (const double below = half_chord2(ray, height_m); below > 0)
    if (const double enters = lowest_at(ray) - std::sqrt(below); enters >= stretch.from_m)
      stretch.to_m = std::min(stretch.to_m, enters);
  return stretch;
}

// No longer than so much: the box around a slanting stretch is as wide as it is long.
std::vector<Stretch> parts_of(const Stretch& stretch, double longest_m) {
  std::vector<Stretch> parts;
  const double length_m = stretch.to_m - stretch.from_m;
  const int count = static_cast<int>(std::max(1.0, std::ceil(length_m / longest_m)));
  const auto at = [&](int i) { return stretch.from_m + static_cast<double>(i) / count * length_m; };
  parts.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) parts.push_back({at(i), at(i + 1)});
  return parts;
}

// What lies below a stretch, or so near to it; nothing where meridians are too close to each other for a box of degrees
// to be a small one.
std::optional<dem::Footprint> beneath(const RayCone& ray, const Stretch& stretch, double margin_m) {
  const Vec3 from = ray.origin_m + stretch.from_m * ray.direction, to = ray.origin_m + stretch.to_m * ray.direction;
  const Geographic a = to_geographic(from), b = to_geographic(to);
  const double length_m = stretch.to_m - stretch.from_m;
  const double to_axis_m = std::hypot(from.x(), from.y());
  if (to_axis_m < 20 * (length_m + margin_m)) return std::nullopt;
  double west = a.lon_deg, east = b.lon_deg;
  if (west > east) std::swap(west, east);
  if (east - west > 180) {
    std::swap(west, east);
    east += 360;
  }
  // A straight way leaves the box of its ends by no more than this.
  const double bend_m = length_m * length_m / to_axis_m;
  return dem::around({std::min(a.lat_deg, b.lat_deg), std::max(a.lat_deg, b.lat_deg), west, east}, margin_m + bend_m);
}

}  // namespace

// Where rocks are looked for: their expected number is no more than kMostRocksOfRays, or there is nothing.
std::optional<RocksNearRays::Places> RocksNearRays::places_along(std::span<const RayCone> rays,
                                                                 std::span<const BlockOnRays> blocks, double left_out_m,
                                                                 const StopToken& stop) const {
  constexpr std::size_t kMostStrips = std::size_t{1} << 19;  // 20 MB; where they were more, whole blocks are searched
  const dem::RockField& field = survey_.field();
  Places found;
  double expected = 0;
  for (const BlockOnRays& block : blocks) {
    const auto all_of = [&](int octave) {
      found.pieces.emplace_back(octave, ancestor_of(block.id, std::min(block.id.level, level_of_rocks(octave))));
    };
    const NodeBounds bounds = bounds_of(block.id, block.low_m, block.high_m);
    const bool bundles =
        !std::all_of(block.rays.begin(), block.rays.end(), [&](std::size_t i) { return rays[i].one(); });
    const dem::Footprint footprint = dem::footprint_of(block.id);
    for (int k = field.smallest_octave(); k <= field.largest_octave() && expected <= kMostRocksOfRays; ++k) {
      if (field.largest_m(k) <= left_out_m) continue;
      if (bundles || block.rays.size() > kFewRays || found.strips.size() > kMostStrips) {
        all_of(k);
        continue;
      }
      const dem::Footprint reaching = dem::around(footprint, field.largest_m(k));
      for (const std::size_t i : block.rays) {
        stop.check();
        const auto stretch = stretch_over(rays[i], bounds, field.largest_m(k));
        if (!stretch) continue;
        const double lowest_m = bounds.low_m - bounds.bulge_m - 1 - field.largest_m(k);
        for (const Stretch& part : parts_of(until_below(rays[i], *stretch, lowest_m), kLength * field.largest_m(k))) {
          const auto box = beneath(rays[i], part, field.largest_m(k));
          if (!box) {
            all_of(k);
            break;
          }
          const auto here = common(*box, reaching);
          if (here) {
            found.strips.push_back({k, *here});
            expected += expected_of(field, k, *here, 0);
          }
        }
      }
    }
  }
  std::sort(found.pieces.begin(), found.pieces.end());
  found.pieces.erase(std::unique(found.pieces.begin(), found.pieces.end()), found.pieces.end());
  for (const auto& [octave, id] : found.pieces) expected += expected_of(field, octave, dem::footprint_of(id), 0);
  if (expected > kMostRocksOfRays) return std::nullopt;
  return found;
}

std::optional<std::vector<dem::RockFeature>> RocksNearRays::along(std::span<const RayCone> rays,
                                                                  std::span<const BlockOnRays> blocks,
                                                                  double left_out_m, const StopToken& stop) {
  const auto places = places_along(rays, blocks, left_out_m, stop);
  if (!places || !find(places->pieces, stop)) return std::nullopt;
  // Strips overlap: a rock may be found several times.
  auto rocks =
      gathered_in_parallel<dem::RockFeature>(places->strips.size(), 64, kMostNewRocks, [&](std::size_t i, auto& some) {
        stop.check();
        survey_.add(places->strips[i].octave, places->strips[i].box, survey_.field().law().smallest_m, some, stop);
      });
  if (!rocks) return std::nullopt;
  for (const Piece& piece : places->pieces) {
    const std::vector<dem::RockFeature>& some = found_.at(piece);
    rocks->insert(rocks->end(), some.begin(), some.end());
  }
  rocks = dem::largest_first(std::move(*rocks));
  if (rocks->size() > kMostRocksOfRays) return std::nullopt;
  return rocks;
}

bool RocksNearRays::find(const std::vector<Piece>& pieces, const StopToken& stop) {
  const dem::RockField& field = survey_.field();
  if (remembered_ > kMostRememberedRocks - kMostNewRocks) {
    found_.clear();
    remembered_ = 0;
  }
  std::vector<Piece> unknown;
  std::copy_if(pieces.begin(), pieces.end(), std::back_inserter(unknown),
               [&](const Piece& piece) { return !found_.contains(piece); });
  std::vector<std::vector<dem::RockFeature>> new_ones(unknown.size());
  std::atomic<std::size_t> number{0};
  in_parallel(unknown.size(), [&](std::size_t i) {
    stop.check();
    if (number > kMostNewRocks) return;
    const auto& [octave, id] = unknown[i];
    const dem::Footprint reaching = dem::around(dem::footprint_of(id), field.largest_m(octave));
    survey_.add(octave, reaching, field.law().smallest_m, new_ones[i], stop);
    number += new_ones[i].size() + 1;  // an empty piece takes memory, too
  });
  if (number > kMostNewRocks) return false;
  for (std::size_t i = 0; i < unknown.size(); ++i) found_.emplace(unknown[i], std::move(new_ones[i]));
  remembered_ += number;
  return true;
}

}  // namespace selenograph::engine
