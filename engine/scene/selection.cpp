#include "engine/scene/selection.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "dem/support/error.h"
#include "dem/support/parallel.h"
#include "engine/scene/light_tree.h"
#include "engine/scene/node_bounds.h"
#include "engine/scene/root_groups.h"

namespace selenograph::engine {
namespace {

using dem::BlockId;
using Chosen = std::unordered_set<BlockId, dem::BlockIdHash>;

struct Known {
  dem::NodeInfo info;
  NodeBounds bounds;
};

// Of lunar relief. What can't matter even so needs no look into a pyramid, which may have to be built first. Only asked
// of nodes that may be the root of one, whatever has been built: of finer ones such bounds say nothing.
constexpr int kLooseLevels = 8;

NodeBounds loose_bounds(const BlockId& id) {
  return bounds_of_all(id, static_cast<double>(dem::kLowestRelief_m), static_cast<double>(dem::kHighestRelief_m));
}

NodeBounds bounds_within(const BlockId& id, const dem::NodeInfo& heights) {
  return bounds_of(id, static_cast<double>(heights.min_m), static_cast<double>(heights.max_m));
}

// What of a node needs no pyramid, or no more than is there: false when it can't matter whatever its heights are, or
// those that its files hold. `matters` must be true of wider bounds where it is of narrower ones, so that answers don't
// depend on what has been built.
template <typename Matters>
bool may_matter(const dem::Terrain& terrain, const BlockId& id, const StopToken& stop, const Matters& matters) {
  if (id.level > kLooseLevels) return true;
  if (!matters(loose_bounds(id))) return false;
  // Files are looked at only where level ground, as low as the maria, would not matter.
  constexpr double kMaria_m = -2000;
  if (!terrain.has_data(id) || matters(bounds_of(id, kMaria_m, kMaria_m))) return true;
  const auto range = terrain.heights_without_building(id, stop);
  return !range || matters(bounds_of_all(id, static_cast<double>(range->low), static_cast<double>(range->high)));
}

// Heights of a node; lunar relief's own bounds where the true ones would cost building everything beneath.
std::optional<Known> known(const dem::Terrain& terrain, const BlockId& id, const StopToken& stop) {
  if (!terrain.has_data(id)) return std::nullopt;
  dem::NodeInfo info{0, dem::kLowestRelief_m, dem::kHighestRelief_m, false, {}};
  if (terrain.node_is_cheap(id)) info = terrain.node(id, stop);
  if (info.empty) return std::nullopt;
  return Known{info, bounds_within(id, info)};
}

// Of blocks finer than the posts there are more than a frame has use for.
struct TooMuchDetail {};

void check(const std::size_t blocks, const StopToken& stop) {
  stop.check();
  if (blocks > kMaxBlocks)
    throw TooMuchTerrain(
        "the view needs more terrain than fits: ask for a larger max_error_px, a narrower field of view or a higher "
        "camera",
        "max_error_px");
}

// 1 / tan of the Sun's elevation over the lowest place of a node: how far a shadow's edge on level ground moves per
// metre of height. Below a hundredth of a degree shadows have no edge to speak of; at a high Sun slopes still move
// them.
double shadow_gain(const NodeBounds& b, const Vec3& sun) {
  constexpr double kLeast = 1, kMost = 5700;
  const double up = std::asin(std::clamp(sun.dot(b.centre) / b.centre.norm(), -1.0, 1.0));
  const double lowest = up - std::asin(std::min(1.0, b.radius_m / b.centre.norm()));
  return lowest <= 0 ? kMost : std::clamp(1 / std::tan(lowest), kLeast, kMost);
}

// Split by a finer neighbour, a block at its finest follows the sphere more closely than the finest surface does: along
// a slope m by the chords' sag times 1 + 2 m^2, because heights linear in the angle aren't linear along the chord. For
// slopes of up to 60 degrees.
double subdivision_error_m(int level) { return 7 * dem::chord_sag_m(level); }

// An aim for detail of a hundred pixels and more is none.
constexpr double kNoAim_px = 100;

class ViewSelector {
 public:
  // The aim for detail is max_error_px at least.
  ViewSelector(const dem::Terrain& terrain, std::span<const ViewBundle> views, const Accuracy& accuracy,
               const SceneRoom& room, const StopToken& stop, const std::vector<Ball>& receivers)
      : terrain_(terrain), views_(views), accuracy_(accuracy), room_(room), stop_(stop), receivers_(receivers) {
    if (!terrain.detail() || !gives_way(accuracy)) return;
    double pixels = 0;
    for (const ViewBundle& view : views)
      pixels = std::max(pixels, static_cast<double>(view.view.camera().width) * view.view.camera().height);
    constexpr double kFewest = 256, kMost = 0.5 * kMaxBlocks;  // of tiny images and of huge ones
    most_of_detail_ = static_cast<std::size_t>(std::clamp(
        pixels * Accuracy::kDetailTrianglesPerPixel / static_cast<double>(dem::triangles_of_block(dem::kMaxLevel)),
        kFewest, kMost));
  }

  static bool gives_way(const Accuracy& accuracy) {
    return accuracy.max_error_px > 0 && accuracy.max_detail_error_px < kNoAim_px;
  }

  Selection select(const Sun* sun) {
    see_roots();
    see_detail();
    if (sun) sharpen_shadows(*sun);
    for (const Seen& s : seen_) count_detail(s.id, -1), choose(s.id, s.info);
    balance();
    report();
    result_.blocks.assign(chosen_.begin(), chosen_.end());
    std::sort(result_.blocks.begin(), result_.blocks.end());
    check_size();
    note_replacements();
    return std::move(result_);
  }

  // Whether the aim for shadows has made anything finer, as far as select() came: a larger one takes less terrain then.
  bool refined_for_shadows() const { return refined_for_shadows_; }

 private:
  struct Seen {
    BlockId id;
    dem::NodeInfo info;
    NodeBounds bounds;
    double pixels_per_metre;
  };

  enum class Look { in_view, out_of_view, nothing };
  struct Looked {
    Look look = Look::nothing;
    std::optional<Seen> seen{};
  };

  Looked looked_at(const BlockId& id) const {
    if (!may_matter(terrain_, id, stop_, [&](const NodeBounds& b) { return may_see(b); })) return {Look::out_of_view};
    const auto node = known(terrain_, id, stop_);
    if (!node) return {Look::nothing};
    const NodeBounds& b = node->bounds;
    if (!may_see(b)) return {Look::out_of_view};
    return {Look::in_view, Seen{id, node->info, b, pixels_per_metre(b)}};
  }

  std::optional<Seen> look_at(const BlockId& id) {
    check(chosen_.size() + seen_.size(), stop_);
    Looked looked = looked_at(id);
    note(id, looked.look);
    return std::move(looked.seen);
  }

  void note(const BlockId& id, Look look) {
    if (look == Look::out_of_view) out_of_view_.push_back(id);
    if (look == Look::nothing) note_void(id);
  }

  static bool may_see(const ViewBundle& view, const NodeBounds& b) {
    return view.may_see(b.centre, b.radius_m) && view.may_see(b.points, b.bulge_m) &&
           !below_horizon(view.view.position(), b, view.shift_m);
  }
  bool may_see(const NodeBounds& b) const {
    return std::any_of(views_.begin(), views_.end(), [&](const ViewBundle& view) { return may_see(view, b); });
  }

  // The largest of the views that may see it.
  double pixels_per_metre(const NodeBounds& b) const {
    double most = 0;
    for (const ViewBundle& view : views_)
      if (views_.size() == 1 || may_see(view, b))
        most = std::max(most, view.pixels_per_metre(b.centre, b.radius_m, b.high_m + b.bulge_m));
    return most;
  }

  void see_roots() {
    std::vector<BlockId> near;
    for (const RootGroup& group : root_groups()) {
      const NodeBounds& b = group.bounds;
      if (!may_see(b))
        groups_out_of_view_.push_back(&group);
      else
        for_each_root(terrain_, group, [&](const BlockId& id) { near.push_back(id); });
    }
    std::sort(near.begin(), near.end());
    for (const BlockId& id : near) see(id);
  }

  void see(const BlockId& id) {
    const auto node = look_at(id);
    if (!node) return;
    if (!refine(id, node->pixels_per_metre)) {
      add_seen(*node);
      return;
    }
    for (const BlockId& child : dem::children_of(id))
      if (terrain_.has_detail(child))
        want_detail(child, node->info, of_detail_in_view_);
      else
        see(child);
  }

  // A block is as high as what it is part of: one that would be out of view even so needn't be made.
  void want_detail(const BlockId& child, const dem::NodeInfo& parent, std::vector<BlockId>& wanted) {
    if (may_see(bounds_within(child, parent)))
      wanted.push_back(child);
    else
      out_of_view_.push_back(child);
  }

  // Blocks with detail are made when they are first looked at, a millisecond each: by all threads. In waves, and those
  // in pieces, so that what is too much is found out before it is made. That is a matter of the blocks alone, not of
  // the threads. judge(id), by any thread; take(id, judged, next wave), one after the other.
  template <typename Judge, typename Take>
  void in_waves(std::vector<BlockId> wave, const Judge& judge, const Take& take) {
    constexpr std::size_t kPiece = 256;
    while (!wave.empty()) {
      std::vector<BlockId> next;
      for (std::size_t first = 0; first < wave.size(); first += kPiece) {
        const std::size_t wanted = wave.size() - first + next.size();
        check(chosen_.size() + seen_.size() + wanted, stop_);
        if (most_of_detail_ != kAny && of_detail_ + wanted > most_of_detail_) throw TooMuchDetail();
        std::vector<std::invoke_result_t<Judge, const BlockId&>> judged(std::min(kPiece, wave.size() - first));
        in_parallel(judged.size(), [&](std::size_t i) {
          stop_.check();
          judged[i] = judge(wave[first + i]);
        });
        for (std::size_t i = 0; i < judged.size(); ++i) take(wave[first + i], judged[i], next);
      }
      wave = std::move(next);
    }
  }

  void see_detail() {
    struct Judged {
      Looked looked;
      bool refine = false;
    };
    in_waves(
        std::exchange(of_detail_in_view_, {}),
        [&](const BlockId& id) {
          Judged judged{looked_at(id)};
          judged.refine = judged.looked.seen && refine(id, judged.looked.seen->pixels_per_metre);
          return judged;
        },
        [&](const BlockId& id, const Judged& judged, std::vector<BlockId>& next) {
          take_detail(id, judged.looked, judged.refine, next);
        });
  }

  // Of what is in view its children are next where it has to be finer.
  void take_detail(const BlockId& id, const Looked& looked, bool finer, std::vector<BlockId>& next) {
    note(id, looked.look);
    if (!looked.seen) return;
    if (finer)
      for (const BlockId& child : dem::children_of(id)) want_detail(child, looked.seen->info, next);
    else
      add_seen(*looked.seen);
  }

  void add_seen(const Seen& seen) {
    count_detail(seen.id, 1);
    seen_.push_back(seen);
  }

  void count_detail(const BlockId& id, std::ptrdiff_t change) {
    if (most_of_detail_ == kAny || !terrain_.has_detail(id)) return;
    of_detail_ += static_cast<std::size_t>(change);
    if (of_detail_ > most_of_detail_) throw TooMuchDetail();
  }

  bool finest(const BlockId& id) const { return id.level >= terrain_.finest_level(id); }

  // The finest surface is what errors are measured to: it has none.
  double error_m(const BlockId& id) const {
    return finest(id) ? 0 : terrain_.node(id, stop_).error_m + dem::chord_sag_m(id.level);
  }
  double detail_error_m(const BlockId& id) const { return finest(id) ? 0 : terrain_.node(id, stop_).detail_error_m; }

  bool refine(const BlockId& id, double pixels_per_metre) const {
    if (finest(id)) return false;
    const double allowed = accuracy_.max_error_px;
    if (allowed == 0) return true;
    const bool coarser_than_posts = !terrain_.has_detail(id) && id.level < terrain_.plain().posts_level(id);
    if (coarser_than_posts && dem::post_spacing_m(id.level) * pixels_per_metre > 2 * allowed) return true;
    // Where the sag alone is too much, the posts' own error, which may have to be computed, is not needed.
    if (dem::chord_sag_m(id.level) * pixels_per_metre > allowed) return true;
    return errs(id, pixels_per_metre);
  }

  // More than it may, as the finest surface has it.
  bool errs(const BlockId& id, double pixels_per_metre) const {
    const double error = error_m(id) * pixels_per_metre, allowed = accuracy_.max_error_px;
    if (error <= allowed || !terrain_.detail()) return error > allowed;
    const double of_detail = detail_error_m(id) * pixels_per_metre;
    return error - of_detail > allowed || error > accuracy_.max_detail_error_px;
  }

  void choose(const BlockId& id, const dem::NodeInfo& info) {
    if (chosen_.insert(id).second) count_detail(id, 1);
    result_.highest_m = std::max(result_.highest_m, static_cast<double>(info.max_m));
  }

  // Pixels per metre: an object next to the camera doesn't ask for terrain finer than there is.
  static constexpr double kSharpest = 1;

  // Refines what can cast a shadow into view, in view itself or not.
  void sharpen_shadows(const Sun& sun) {
    Vec3 middle = Vec3::Zero();
    for (const Seen& s : seen_) middle += s.bounds.centre.normalized();
    LightTree receivers(sun, middle);
    for (const Seen& s : seen_)
      receivers.add_receiver(s.bounds, s.pixels_per_metre * shadow_gain(s.bounds, sun.direction));
    for (const Ball& ball : receivers_) {
      double sharpness = 0;
      for (const ViewBundle& view : views_)
        if (view.may_see(ball.centre_m, ball.radius_m))
          sharpness = std::max(sharpness, view.pixels_per_metre(ball.centre_m, ball.radius_m));
      if (sharpness == 0) continue;
      const NodeBounds bounds = bounds_around(ball.centre_m, ball.radius_m);
      receivers.add_receiver(bounds, std::min(kSharpest, sharpness) * shadow_gain(bounds, sun.direction));
    }
    receivers.finish();
    of_detail_ = 0;
    for (const Seen& s : std::exchange(seen_, {})) sharpen(s, receivers);
    sharpen_detail(receivers);
    std::vector<BlockId> of_detail;
    for (const BlockId& id : std::exchange(out_of_view_, {}))
      if (terrain_.has_detail(id))
        want_caster(id, terrain_.node(dem::ancestor_of(id, id.level - 1), stop_), receivers, of_detail);
      else
        cast(id, receivers, of_detail);
    for (const RootGroup* group : groups_out_of_view_)
      if (receivers.shaded_pixels_per_metre(group->bounds) > 0)
        for_each_root(terrain_, *group, [&](const BlockId& id) { cast(id, receivers, of_detail); });
    cast_detail(std::move(of_detail), receivers);
  }

  // What a block's error does to shadow edges, pixels; whether that is too much and finer posts would help.
  struct Blur {
    bool too_much = false;
    double displaced_px = 0;
  };
  Blur blur(const BlockId& id, double displaced_pixels_per_metre) const {
    if (displaced_pixels_per_metre == 0 || finest(id)) return {};
    if (accuracy_.max_error_px == 0) return {true};
    // The error of a block far coarser than its posts has to be built first, with all that is beneath. Where it would
    // have to be less than a 16th of the spacing, finer blocks are taken without asking: they do as well.
    constexpr double kWorthAsking = 16;
    if (!terrain_.node_is_cheap(id) &&
        dem::post_spacing_m(id.level) * displaced_pixels_per_metre > kWorthAsking * accuracy_.max_shadow_error_px)
      return {true};
    const double displaced_px = error_m(id) * displaced_pixels_per_metre;
    return {displaced_px > accuracy_.max_shadow_error_px, displaced_px};
  }
  bool too_much(const Blur& blur) {
    refined_for_shadows_ |= blur.too_much && accuracy_.max_error_px > 0;
    if (!blur.too_much) result_.shadow_error_px = std::max(result_.shadow_error_px, blur.displaced_px);
    return blur.too_much;
  }

  void sharpen(const Seen& seen, const LightTree& receivers) {
    if (!too_much(blur(seen.id, receivers.shaded_pixels_per_metre(seen.bounds)))) {
      add_seen(seen);
      return;
    }
    for (const BlockId& child : dem::children_of(seen.id)) {
      if (terrain_.has_detail(child))
        want_detail(child, seen.info, of_detail_in_view_);
      else if (const auto node = look_at(child))
        sharpen(*node, receivers);
    }
  }

  void sharpen_detail(const LightTree& receivers) {
    struct Judged {
      Looked looked;
      Blur blur{};
    };
    in_waves(
        std::exchange(of_detail_in_view_, {}),
        [&](const BlockId& id) {
          Judged judged{looked_at(id)};
          if (const auto& seen = judged.looked.seen)
            judged.blur = blur(id, receivers.shaded_pixels_per_metre(seen->bounds));
          return judged;
        },
        [&](const BlockId& id, const Judged& judged, std::vector<BlockId>& next) {
          take_detail(id, judged.looked, judged.looked.seen && too_much(judged.blur), next);
        });
  }

  // What casts shadows into view from outside of it.
  struct Caster {
    bool matters = false, too_coarse = false;
    dem::NodeInfo info{};
    Blur blur{};
  };
  Caster caster(const BlockId& id, const LightTree& receivers) const {
    if (!may_matter(terrain_, id, stop_, [&](const NodeBounds& b) { return receivers.shaded_pixels_per_metre(b) > 0; }))
      return {};
    const auto node = known(terrain_, id, stop_);
    if (!node) return {};
    const double displaced = receivers.shaded_pixels_per_metre(node->bounds);
    if (displaced == 0) return {};
    // Large blocks overlap much that they don't shade: they are split until their bounds mean something.
    if (id.level < dem::kRootLevel + 1 && !finest(id)) return {true, true, node->info};
    return {true, false, node->info, blur(id, displaced)};
  }

  // Of what is too coarse, the children: those with detail are for later.
  void cast(const BlockId& id, const LightTree& receivers, std::vector<BlockId>& of_detail) {
    check(chosen_.size() + seen_.size(), stop_);
    const Caster judged = caster(id, receivers);
    if (!take_caster(id, judged)) return;
    for (const BlockId& child : dem::children_of(id))
      if (terrain_.has_detail(child))
        want_caster(child, judged.info, receivers, of_detail);
      else
        cast(child, receivers, of_detail);
  }

  static void want_caster(const BlockId& child, const dem::NodeInfo& parent, const LightTree& receivers,
                          std::vector<BlockId>& wanted) {
    if (receivers.shaded_pixels_per_metre(bounds_within(child, parent)) > 0) wanted.push_back(child);
  }

  void cast_detail(std::vector<BlockId> wave, const LightTree& receivers) {
    in_waves(
        std::move(wave), [&](const BlockId& id) { return caster(id, receivers); },
        [&](const BlockId& id, const Caster& judged, std::vector<BlockId>& next) {
          if (!take_caster(id, judged)) return;
          for (const BlockId& child : dem::children_of(id)) want_caster(child, judged.info, receivers, next);
        });
  }

  // Whether it has to be finer.
  bool take_caster(const BlockId& id, const Caster& caster) {
    if (!caster.matters) return false;
    if (caster.too_coarse || too_much(caster.blur)) return true;
    choose(id, caster.info);
    return false;
  }

  // Bounds over what is in view.
  void report() {
    if (!seen_.empty()) result_.min_spacing_m = std::numeric_limits<double>::infinity();
    for (const Seen& s : seen_) {
      const bool split = finest(s.id) && !chosen_.contains(s.id);
      const double error = split ? subdivision_error_m(s.id.level) : error_m(s.id),
                   spacing = dem::post_spacing_m(s.id.level);
      result_.error_m = std::max(result_.error_m, error);
      result_.error_px = std::max(result_.error_px, error * s.pixels_per_metre);
      if (terrain_.detail())
        result_.detail_error_px = std::max(result_.detail_error_px, detail_error_m(s.id) * s.pixels_per_metre);
      result_.min_spacing_m = std::min(result_.min_spacing_m, spacing);
      result_.max_spacing_m = std::max(result_.max_spacing_m, spacing);
    }
    for (const BlockId& id : chosen_)
      if (const auto seen = in_view_.find(id); seen != in_view_.end())
        around(id, [&](std::int32_t lat, std::int32_t lon) {
          const BlockId* neighbour = covering(lat, lon, id.level);
          const double error = neighbour && follows(id, *neighbour) ? error_m(*neighbour) : 0;
          result_.error_m = std::max(result_.error_m, error);
          result_.error_px = std::max(result_.error_px, error * seen->second);
        });
  }

  // Something in view that an unusable file alone would have filled is not among the blocks, but lacks it.
  void note_void(const BlockId& id) {
    if (!terrain_.has_replacements() || !terrain_.has_data(id) || !terrain_.node_is_cheap(id)) return;
    if (may_see(loose_bounds(id))) note_replaced(id);
  }

  void note_replaced(const BlockId& id) {
    const std::vector<dem::SourceIndex> here = terrain_.node(id, stop_).replaced;
    result_.replaced.insert(result_.replaced.end(), here.begin(), here.end());
  }

  void note_replacements() {
    if (!terrain_.has_replacements()) return;
    for (const BlockId& id : result_.blocks) note_replaced(id);
    std::sort(result_.replaced.begin(), result_.replaced.end());
    result_.replaced.erase(std::unique(result_.replaced.begin(), result_.replaced.end()), result_.replaced.end());
  }

  // What most of the terrain is there for.
  const char* wanting() const { return 2 * of_detail_ > chosen_.size() ? "max_detail_error_px" : "max_error_px"; }

  void check_size() const {
    std::size_t needed = 0;
    for (const BlockId& id : result_.blocks) needed += scene_bytes_of(id, room_.visibility);
    if (needed > room_.bytes)
      throw TooMuchTerrain(fmt::format("the view needs {} MB for its terrain, {} MB are allowed: ask for a larger {} "
                                       "or a narrower view",
                                       needed >> 20, room_.bytes >> 20, wanting()),
                           wanting());
  }

  // The chosen block that holds a place, at `level` or coarser.
  const BlockId* covering(std::int32_t lat, std::int32_t lon, int level) const {
    for (int n = level; n >= 0; --n)
      if (const auto found = chosen_.find(dem::block_at(n, lat, lon)); found != chosen_.end()) return &*found;
    return nullptr;
  }

  // visit(latitude, longitude) just outside of each side's middle and of each corner.
  template <typename Visit>
  static void around(const BlockId& id, const Visit& visit) {
    const dem::BlockExtent e = dem::extent_of(id);
    const std::int64_t south = e.lat0 - 1, north = e.lat1(), west = std::int64_t{e.lon0} - 1, east = e.lon1();
    const std::int64_t mid_lat = (e.lat0 + e.lat1()) / 2, mid_lon = (std::int64_t{e.lon0} + e.lon1()) / 2;
    for (const std::int64_t lat : {south, mid_lat, north}) {
      if (lat < 0 || lat >= dem::kLatTicks) continue;
      for (const std::int64_t lon : {west, mid_lon, east})
        if (lat != mid_lat || lon != mid_lon) visit(static_cast<std::int32_t>(lat), dem::wrap_lon(lon));
    }
  }

  // Whether a joined edge follows a coarser neighbour out of view. (One in view has bounds of its own.)
  bool follows(const BlockId& id, const BlockId& neighbour) const {
    return neighbour.level < id.level && in_view_.contains(id) && !in_view_.contains(neighbour);
  }

  bool must_split(const BlockId& neighbour, const BlockId& id) const {
    if (neighbour.level < id.level - 1) return true;
    return follows(id, neighbour) && errs(neighbour, in_view_.at(id));
  }

  // Splits blocks until neighbours differ by at most one level, so that edges join vertex by vertex, and until no edge
  // in view is worse than what is promised.
  void balance() {
    for (const Seen& s : seen_) in_view_[s.id] = s.pixels_per_metre;
    std::vector<BlockId> todo(chosen_.begin(), chosen_.end());
    std::sort(todo.begin(), todo.end());
    while (!todo.empty()) {
      const BlockId id = todo.back();
      todo.pop_back();
      if (!chosen_.contains(id)) continue;
      around(id, [&](std::int32_t lat, std::int32_t lon) {
        for (const BlockId* coarser = covering(lat, lon, id.level); coarser && must_split(*coarser, id);
             coarser = covering(lat, lon, id.level))
          split(*coarser, todo);
      });
      check(chosen_.size(), stop_);
    }
  }

  // By value: the block is on its way out of the set that holds it.
  void split(const BlockId id, std::vector<BlockId>& todo) {
    const auto seen = in_view_.find(id);
    const double sharpness = seen == in_view_.end() ? 0 : seen->second;
    chosen_.erase(id), count_detail(id, -1);
    const std::vector<BlockId> children = dem::children_of(id);
    std::vector<std::optional<Known>> nodes(children.size());
    const auto look = [&](std::size_t i) { nodes[i] = known(terrain_, children[i], stop_); };
    if (terrain_.has_detail(children.front()))
      in_parallel(children.size(), look);
    else
      for (std::size_t i = 0; i < children.size(); ++i) look(i);
    for (std::size_t i = 0; i < children.size(); ++i) {
      const BlockId& child = children[i];
      const std::optional<Known>& node = nodes[i];
      if (!node) continue;
      choose(child, node->info);
      todo.push_back(child);
      if (sharpness > 0) in_view_[child] = sharpness;
    }
  }

  const dem::Terrain& terrain_;
  std::span<const ViewBundle> views_;
  const Accuracy& accuracy_;
  SceneRoom room_;
  const StopToken& stop_;
  const std::vector<Ball>& receivers_;
  static constexpr std::size_t kAny = std::numeric_limits<std::size_t>::max();
  std::size_t most_of_detail_ = kAny, of_detail_ = 0;  // blocks finer than the posts
  Chosen chosen_;
  std::vector<Seen> seen_;
  std::unordered_map<BlockId, double, dem::BlockIdHash> in_view_;  // pixels per metre; parts of what was split, too
  std::vector<BlockId> out_of_view_, of_detail_in_view_;           // the latter are still to be looked at
  std::vector<const RootGroup*> groups_out_of_view_;
  bool refined_for_shadows_ = false;
  Selection result_;
};

// Whether a ray passes through a node: within its ball it must come below the highest height.
bool may_meet(const Ray& ray, const NodeBounds& b, double above_m) {
  const Vec3 to = b.centre - ray.origin_m;
  const double along = to.dot(ray.direction), off2 = to.squaredNorm() - along * along, reach = b.radius_m + above_m,
               reach2 = reach * reach;
  if (off2 > reach2) return false;
  const double half = std::sqrt(reach2 - off2), t0 = std::max(0.0, along - half), t1 = along + half;
  if (t1 < 0) return false;
  const double closest = std::clamp(-ray.origin_m.dot(ray.direction), t0, t1);
  return (ray.origin_m + closest * ray.direction).norm() <= kMoonRadius_m + b.high_m + b.bulge_m + 1 + above_m;
}

// False once there are too many.
bool follow(const dem::Terrain& terrain, const std::vector<Ray>& rays, const std::vector<std::size_t>& some,
            const BlockId& id, std::size_t max_blocks, double above_m, std::vector<BlockOnRays>& out,
            const StopToken& stop) {
  stop.check();
  const bool worth_asking = may_matter(terrain, id, stop, [&](const NodeBounds& b) {
    return std::any_of(some.begin(), some.end(), [&](std::size_t i) { return may_meet(rays[i], b, above_m); });
  });
  if (!worth_asking) return true;
  const auto node = known(terrain, id, stop);
  if (!node) return true;
  std::vector<std::size_t> meeting;
  for (const std::size_t i : some)
    if (may_meet(rays[i], node->bounds, above_m)) meeting.push_back(i);
  if (meeting.empty()) return true;
  if (id.level < terrain.finest_level(id)) {
    const std::vector<BlockId> children = dem::children_of(id);
    return std::all_of(children.begin(), children.end(), [&](const BlockId& child) {
      return follow(terrain, rays, meeting, child, max_blocks, above_m, out, stop);
    });
  }
  out.push_back({id, static_cast<double>(node->info.min_m), static_cast<double>(node->info.max_m), std::move(meeting)});
  return out.size() <= max_blocks;
}

// Consecutive frames share an anchor: it is snapped to a lattice.
constexpr double kFinestAnchorLattice_m = 4096, kCoarsestAnchorLattice_m = 32768;

// Distance (in the direction's lengths) at which a ray enters the sphere; 0 from inside, empty when it misses or
// leaves.
std::optional<double> enter_sphere(const Vec3& origin, const Vec3& direction, double radius) {
  const double outside = origin.squaredNorm() - radius * radius;
  if (outside <= 0) return 0.0;
  const double a = direction.squaredNorm(), b = origin.dot(direction);
  const double root2 = b * b - a * outside;
  if (b >= 0 || root2 < 0) return std::nullopt;
  return outside / (-b + std::sqrt(root2));  // the stable form of the nearer root
}

// `when`: "", or in which row, with a blank.
void refuse_buried(const dem::Terrain& terrain, const Vec3& position_m, const std::string& when,
                   const StopToken& stop) {
  const double height = position_m.norm() - kMoonRadius_m;
  if (height > static_cast<double>(dem::kHighestRelief_m)) return;
  const Geographic g = to_geographic(position_m);
  const dem::HeightAnswer ground = terrain.height(g.lat_deg, g.lon_deg, stop);
  const double lowest = std::isnan(ground.height_m) ? static_cast<double>(dem::kLowestRelief_m) : ground.height_m;
  if (height <= lowest)
    throw ImpossibleRequest(
        fmt::format("{}the camera is below the terrain: {:.3f} m above the sphere, ground at {:.3f} m", when, height,
                    lowest),
        when.empty() ? "" : "shutter");
}

}  // namespace

Selection select_for_view(const dem::Terrain& terrain, const View& view, const Sun* sun, const Accuracy& accuracy,
                          const StopToken& stop, const SceneRoom& room, const std::vector<Ball>& receivers) {
  const ViewBundle one{view};
  return select_for_views(terrain, {&one, 1}, sun, accuracy, stop, room, receivers);
}

Selection select_for_views(const dem::Terrain& terrain, std::span<const ViewBundle> views, const Sun* sun,
                           const Accuracy& accuracy, const StopToken& stop, const SceneRoom& room,
                           const std::vector<Ball>& receivers) {
  Accuracy asked = accuracy;
  asked.max_detail_error_px = asked.detail_aim_px();
  const auto relax_shadows = [&] { asked.max_shadow_error_px = std::max(2 * asked.max_shadow_error_px, 1.0 / 16); };
  for (;;) {
    ViewSelector selector(terrain, views, asked, room, stop, receivers);
    try {
      Selection selection = selector.select(sun);
      selection.shadow_limit_px = asked.max_shadow_error_px;
      if (terrain.detail()) selection.detail_limit_px = asked.max_detail_error_px;
      return selection;
    } catch (const TooMuchDetail&) {
      asked.max_detail_error_px = std::max(2 * asked.max_detail_error_px, 1.0 / 16);
      if (sun && asked.max_shadow_error_px < kNoAim_px) relax_shadows();
    } catch (const TooMuchTerrain&) {
      if (!selector.refined_for_shadows()) throw;
      relax_shadows();
    }
  }
}

std::optional<std::vector<BlockOnRays>> select_for_rays(const dem::Terrain& terrain, const std::vector<Ray>& rays,
                                                        std::size_t max_blocks, const StopToken& stop, double above_m) {
  std::vector<BlockOnRays> blocks;
  std::vector<std::size_t> all(rays.size());
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
  std::vector<BlockId> near;
  for (const RootGroup& group : root_groups())
    if (std::any_of(rays.begin(), rays.end(), [&](const Ray& ray) { return may_meet(ray, group.bounds, above_m); }))
      for_each_root(terrain, group, [&](const BlockId& id) { near.push_back(id); });
  std::sort(near.begin(), near.end());
  for (const BlockId& id : near)
    if (!follow(terrain, rays, all, id, max_blocks, above_m, blocks, stop)) return std::nullopt;
  std::sort(blocks.begin(), blocks.end(), [](const BlockOnRays& a, const BlockOnRays& b) { return a.id < b.id; });
  return blocks;
}

double triangles_of(const Selection& selection) {
  double triangles = 0;
  for (const BlockId& id : selection.blocks) triangles += static_cast<double>(dem::triangles_of_block(id.level));
  return triangles;
}

Visibility visibility_for(const FrameRequest& request, const RowViews& views, const Selection& selection) {
  if (!request.terrain) return Visibility::raytrace;  // nothing to draw
  if (request.shutter) {
    if (request.visibility == Visibility::zbuffer)
      throw ImpossibleRequest("rows with times are rendered by ray tracing: the z-buffer draws all rows from one place",
                              "visibility");
    return Visibility::raytrace;
  }
  if (request.camera.model == CameraModel::fisheye) {
    if (request.visibility == Visibility::zbuffer)
      throw ImpossibleRequest("a fisheye is rendered by ray tracing: the z-buffer draws onto a plane", "visibility");
    return Visibility::raytrace;
  }
  if (request.visibility != Visibility::automatic) return request.visibility;
  // Triangles per pixel where both take equally long, measured by selenograph_benchmark --benchmark_filter=dense, whose
  // Suns are at 3, 15 and 45 degrees and at 15 with its disc. Under a low Sun triangles shade more samples; of the
  // Sun's disc rays ask for hundreds of directions.
  constexpr double kMostWithDisc = 3000, kMostAtLowSun = 550, kMost = 850;
  constexpr double kLow = 0.1;  // sine of the Sun's elevation, as where the shadow map's order changes
  const View& view = views.reference();
  double most = kMost;
  if (request.sun.angular_radius_deg > 0)
    most = kMostWithDisc;
  else if (anchor_for(view.position(), view.middle()).normalized().dot(request.sun.direction) < kLow)
    most = kMostAtLowSun;
  const double pixels = static_cast<double>(request.camera.width) * request.camera.height;
  return triangles_of(selection) > most * pixels ? Visibility::raytrace : Visibility::zbuffer;
}

Vec3 anchor_for(const Vec3& camera_m, const Vec3& middle, double clearance_m) {
  const double distance = camera_m.norm();
  Vec3 near = camera_m * (kMoonRadius_m / distance);
  const double ahead = -camera_m.dot(middle);
  if (distance > 1.2 * kMoonRadius_m && ahead > 0) {
    // Past the limb: the surface that the middle passes closest, which is what a telescope may have in view.
    const auto t = enter_sphere(camera_m, middle, kMoonRadius_m);
    near = t ? Vec3(camera_m + *t * middle) : Vec3((camera_m + ahead * middle).normalized() * kMoonRadius_m);
  }
  double lattice_m = kFinestAnchorLattice_m;
  while (lattice_m < kCoarsestAnchorLattice_m && lattice_m <= 2 * clearance_m) lattice_m *= 2;
  return (near / lattice_m).array().round() * lattice_m;
}

void refuse_underground(const dem::Terrain& terrain, const RowViews& views, const StopToken& stop) {
  if (!views.vary()) return refuse_buried(terrain, views.reference().position(), "", stop);
  for (int row = 0; row < views.height(); ++row) {
    stop.check();
    refuse_buried(terrain, views.of(row).position(), fmt::format("in row {} ", row), stop);
  }
}

}  // namespace selenograph::engine
