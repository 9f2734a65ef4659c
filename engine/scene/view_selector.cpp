#include "engine/scene/view_selector.h"

#include <fmt/format.h>

#include <cmath>

#include "dem/base/error.h"
#include "dem/detail/detail.h"

namespace selenograph::engine {
namespace {

using dem::BlockId;

// Split by a finer neighbour, a block at its finest follows the sphere more closely than the finest surface does: along
// a slope m by the chords' sag times 1 + 2 m^2, because heights linear in the angle aren't linear along the chord. For
// slopes of up to 60 degrees.
double subdivision_error_m(int level) { return 7 * dem::chord_sag_m(level); }

}  // namespace

void ViewSelector::check(const std::size_t blocks, const StopToken& stop) {
  stop.check();
  if (blocks > kMaxBlocks)
    throw TooMuchTerrain(
        "the view needs more terrain than fits: ask for a larger max_error_px, a narrower field of view or a higher "
        "camera",
        "max_error_px");
}

ViewSelector::ViewSelector(const dem::Terrain& terrain, std::span<const ViewBundle> views, const Accuracy& accuracy,
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
  most_in_view_ = most_of_detail_ / 5 * 4;
}

Selection ViewSelector::select(const Sun* sun) {
  see_roots();
  see_detail();
  if (sun) sharpen_shadows(*sun);
  for (const Seen& s : seen_) {
    count_detail(s.id, -1);
    choose(s.id, s.info.max_m);
  }
  balance();
  report();
  result_.blocks.assign(chosen_.begin(), chosen_.end());
  std::sort(result_.blocks.begin(), result_.blocks.end());
  find_coarser_beside();
  check_size();
  note_replacements();
  return std::move(result_);
}

ViewSelector::Looked ViewSelector::looked_at(const BlockId& id) const {
  if (!may_matter(terrain_, id, stop_, [&](const NodeBounds& b) { return may_see(b); })) return {Look::out_of_view};
  if (const auto outline = terrain_.outline(id, stop_)) {
    const NodeBounds b = bounds_of_all(id, static_cast<double>(outline->min_m), static_cast<double>(outline->max_m));
    if (!may_see(b)) return {Look::out_of_view};
    if (surely_refined(id, *outline, b)) return {Look::in_view, Seen{id, *outline, b, pixels_per_metre(b)}, true};
  }
  const auto node = known(terrain_, id, stop_);
  if (!node) return {Look::nothing};
  if (!may_see(node->bounds)) return {Look::out_of_view};
  Looked looked{Look::in_view, seen_of(id, *node)};
  looked.seen->pixels_per_metre = pixels_per_metre(node->bounds);
  return looked;
}

ViewSelector::Seen ViewSelector::seen_of(const BlockId& id, const Known& node) const {
  Seen seen{id, node.info, node.bounds, 0, finest(id)};
  if (seen.finest)
    seen.errors = Errors{};
  else if (!node.loose)
    seen.errors = errors_of(id, node.info);
  return seen;
}

void ViewSelector::Part::note(const BlockId& id, Look look) {
  if (look == Look::out_of_view) out_of_view.push_back(id);
  if (look == Look::nothing) nothing.push_back(id);
}

void ViewSelector::Part::append(Part&& next) {
  const auto join = [](auto& to, auto& from) {
    to.insert(to.end(), std::make_move_iterator(from.begin()), std::make_move_iterator(from.end()));
  };
  join(seen, next.seen);
  join(out_of_view, next.out_of_view);
  join(nothing, next.nothing);
  join(of_detail, next.of_detail);
  join(casters, next.casters);
  shadow_error_px = std::max(shadow_error_px, next.shadow_error_px);
}

void ViewSelector::take(Part&& part) {
  for (const Seen& seen : part.seen) add_seen(seen);
  out_of_view_.insert(out_of_view_.end(), part.out_of_view.begin(), part.out_of_view.end());
  for (const BlockId& id : part.nothing) note_void(id);
  of_detail_in_view_.insert(of_detail_in_view_.end(), part.of_detail.begin(), part.of_detail.end());
  for (const auto& [id, highest_m] : part.casters) choose(id, highest_m);
  result_.shadow_error_px = std::max(result_.shadow_error_px, part.shadow_error_px);
}

bool ViewSelector::may_see(const ViewBundle& view, const NodeBounds& b) {
  return view.may_see(b.centre, b.radius_m) && view.may_see(b.points, b.bulge_m) &&
         !below_horizon(view.view.position(), b, view.shift_m);
}

bool ViewSelector::may_see(const NodeBounds& b) const {
  return std::any_of(views_.begin(), views_.end(), [&](const ViewBundle& view) { return may_see(view, b); });
}

double ViewSelector::pixels_per_metre(const NodeBounds& b) const {
  double most = 0;
  for (const ViewBundle& view : views_)
    if (views_.size() == 1 || may_see(view, b))
      most = std::max(most, view.pixels_per_metre(b.centre, b.radius_m, b.high_m + b.bulge_m));
  return most;
}

void ViewSelector::see_roots() {
  std::vector<BlockId> near;
  for (const RootGroup& group : root_groups()) {
    const NodeBounds& b = group.bounds;
    if (!may_see(b))
      groups_out_of_view_.push_back(&group);
    else
      for_each_root(terrain_, group, [&](const BlockId& id) { near.push_back(id); });
  }
  std::sort(near.begin(), near.end());
  take_all(near.size(), 1, [&](std::size_t i, Part& part) { see(near[i], part); });
}

void ViewSelector::see(const BlockId& id, Part& part) const {
  stop_.check();
  Looked looked = looked_at(id);
  part.note(id, looked.look);
  if (!looked.seen) return;
  if (!refine(*looked.seen)) {
    count_block();
    part.seen.push_back(std::move(*looked.seen));
    return;
  }
  const std::vector<BlockId> children = dem::children_of(id);
  const auto see_child = [&](const BlockId& child, Part& of_child) {
    if (terrain_.has_detail(child))
      want_detail(child, looked.seen->info, of_child);
    else
      see(child, of_child);
  };
  // Of the few roots in view, these levels have enough nodes for all threads.
  constexpr int kDivided = 3;
  if (id.level >= dem::kRootLevel + kDivided || children.size() == 1) {
    for (const BlockId& child : children) see_child(child, part);
    return;
  }
  std::vector<Part> parts(children.size());
  in_parallel(children.size(), [&](std::size_t i) { see_child(children[i], parts[i]); });
  for (Part& of_child : parts) part.append(std::move(of_child));
}

void ViewSelector::want_detail(const BlockId& child, const dem::NodeInfo& parent, Part& part) const {
  (may_see(bounds_within(child, parent)) ? part.of_detail : part.out_of_view).push_back(child);
}

void ViewSelector::see_detail() {
  struct Judged {
    Looked looked;
    bool refine = false;
  };
  in_waves(
      std::exchange(of_detail_in_view_, {}), most_in_view_,
      [&](const BlockId& id) {
        Judged judged{looked_at(id)};
        judged.refine = judged.looked.too_coarse || (judged.looked.seen && refine(*judged.looked.seen));
        return judged;
      },
      [&](const BlockId& id, const Judged& judged, std::vector<BlockId>& next) {
        take_detail(id, judged.looked, judged.refine, {}, next);
      });
}

void ViewSelector::take_detail(const BlockId& id, const Looked& looked, bool finer, Part part,
                               std::vector<BlockId>& next) {
  part.note(id, looked.look);
  if (looked.seen && finer)
    for (const BlockId& child : dem::children_of(id)) want_detail(child, looked.seen->info, part);
  else if (looked.seen)
    part.seen.push_back(*looked.seen);
  next.insert(next.end(), part.of_detail.begin(), part.of_detail.end());
  part.of_detail.clear();
  take(std::move(part));
}

void ViewSelector::add_seen(const Seen& seen) {
  count_detail(seen.id, 1);
  seen_.push_back(seen);
}

void ViewSelector::count_detail(const BlockId& id, std::ptrdiff_t change) {
  if (most_of_detail_ == kAny || !terrain_.has_detail(id)) return;
  of_detail_ += static_cast<std::size_t>(change);
  if (of_detail_ > most_of_detail_) throw TooMuchDetail();
}

ViewSelector::Errors ViewSelector::errors_of(const BlockId& id, const dem::NodeInfo& info) {
  const double steepest = std::max(static_cast<double>(info.max_m - info.min_m) / dem::post_spacing_m(id.level), 0.0);
  return {info.error_m + dem::chord_sag_m(id.level) + dem::parallel_shift_m(id) * steepest, info.detail_error_m,
          info.left_out_size_m, static_cast<double>(info.max_m)};
}

ViewSelector::Errors ViewSelector::errors_of(const BlockId& id) const {
  return finest(id) ? Errors{} : errors_of(id, terrain_.node(id, stop_));
}

bool ViewSelector::refine(const Seen& seen) const {
  if (seen.finest) return false;
  const BlockId& id = seen.id;
  const double pixels_per_metre = seen.pixels_per_metre;
  const double allowed = accuracy_.max_error_px;
  if (allowed == 0) return true;
  const bool coarser_than_posts = !terrain_.has_detail(id) && id.level < terrain_.plain().posts_level(id);
  if (coarser_than_posts && dem::post_spacing_m(id.level) * pixels_per_metre > 2 * allowed) return true;
  // Where the sag alone is too much, the posts' own error, which may have to be computed, is not needed.
  if (dem::chord_sag_m(id.level) * pixels_per_metre > allowed) return true;
  return errs(id, errors_of(seen), pixels_per_metre);
}

bool ViewSelector::errs(const BlockId& id, const Errors& errors, double pixels_per_metre) const {
  const double error = errors.all_m * pixels_per_metre, allowed = accuracy_.max_error_px;
  if (error <= allowed || !terrain_.detail()) return error > allowed;
  const double of_detail = errors.of_detail_m * pixels_per_metre;
  return error - of_detail > allowed || shades_otherwise(id, errors, pixels_per_metre);
}

bool ViewSelector::surely_refined(const BlockId& id, const dem::NodeInfo& outline, const NodeBounds& bounds) const {
  if (accuracy_.max_error_px == 0) return true;
  double least = 0;
  for (const ViewBundle& view : views_)
    least = std::max(least, view.view.least_pixels_per_metre(bounds.centre, bounds.radius_m));
  // The higher it is, the more obliquely it is seen.
  const Errors errors{outline.error_m, outline.detail_error_m, outline.left_out_size_m, bounds.high_m};
  return errors.all_m * least > accuracy_.max_error_px && shades_otherwise(id, errors, least);
}

bool ViewSelector::shades_otherwise(const BlockId& id, const Errors& errors, double pixels_per_metre) const {
  const double size_px = errors.left_out_size_m * pixels_per_metre,
               shown_px = Accuracy::kSmallestShown * accuracy_.max_detail_error_px;
  return size_px > shown_px && size_px * foreshortening(id, errors.highest_m) > shown_px;
}

double ViewSelector::foreshortening(const BlockId& id, double highest_m) const {
  const dem::BlockExtent e = dem::extent_of(id);
  const Geographic middle{dem::lat_deg_of(e.lat0 + (e.lat1() - e.lat0) / 2),
                          dem::lon_deg_of(e.lon0 + (e.lon1() - e.lon0) / 2), highest_m};
  const Vec3 place = to_cartesian(middle), up = place.normalized();
  // Beyond some 87 degrees slopes face the camera.
  constexpr double kGrazing = 0.05;
  double most = kGrazing;
  for (const ViewBundle& view : views_) most = std::max(most, (view.view.position() - place).normalized().dot(up));
  return std::sqrt(most);
}

void ViewSelector::choose(const BlockId& id, float highest_m) {
  if (chosen_.insert(id).second) count_detail(id, 1);
  result_.highest_m = std::max(result_.highest_m, static_cast<double>(highest_m));
}

// Returns a block's expected error: the bound for the posts, and for the detail what it omits on 99 % of the ground.
BlockError ViewSelector::expected_of(const Seen& seen, double bound_m, const Errors& errors) const {
  double error_m = bound_m;
  if (terrain_.detail() && errors.of_detail_m > 0)
    error_m += std::min(errors.of_detail_m, terrain_.detail()->expected_left_out_m(errors.left_out_size_m)) -
               errors.of_detail_m;
  const NodeBounds& b = seen.bounds;
  double sine = 0, cosine = 0;
  for (const ViewBundle& view : views_) {
    const Vec3& camera_m = view.view.position();
    sine = std::max(sine, largest_sine_of_emission(camera_m, b.centre, b.radius_m));
    cosine = std::max(cosine, (camera_m - b.centre).normalized().dot(b.centre.normalized()));
  }
  const dem::BlockExtent e = dem::extent_of(seen.id);
  const double side_m = e.quads * dem::post_spacing_m(seen.id.level),
               area_m2 =
                   side_m * side_m * e.lon_step / e.lat_step * std::hypot(b.centre.x(), b.centre.y()) / b.centre.norm();
  const double pixels = area_m2 * std::max(cosine, 0.05) * seen.pixels_per_metre * seen.pixels_per_metre;
  return {pixels, error_m, error_m * sine * seen.pixels_per_metre};
}

void ViewSelector::report() {
  std::vector<BlockError> expected;
  expected.reserve(seen_.size());
  if (!seen_.empty()) result_.min_spacing_m = std::numeric_limits<double>::infinity();
  for (const Seen& s : seen_) {
    const bool split = s.finest && !chosen_.contains(s.id);
    const Errors errors = errors_of(s);
    const double error = split ? subdivision_error_m(s.id.level) : errors.all_m,
                 spacing = dem::post_spacing_m(s.id.level);
    result_.error_m = std::max(result_.error_m, error);
    result_.error_px = std::max(result_.error_px, error * s.pixels_per_metre);
    expected.push_back(expected_of(s, error, split ? Errors{} : errors));
    if (terrain_.detail())
      result_.detail_error_px = std::max(result_.detail_error_px, errors.of_detail_m * s.pixels_per_metre);
    result_.min_spacing_m = std::min(result_.min_spacing_m, spacing);
    result_.max_spacing_m = std::max(result_.max_spacing_m, spacing);
  }
  result_.expected_error_px = expected_error(expected, &BlockError::error_px);
  result_.expected_error_m = expected_error(std::move(expected), &BlockError::error_m);
  const std::vector<BlockId> ids(chosen_.begin(), chosen_.end());
  struct Worst {
    double error_m = 0, error_px = 0;
  };
  constexpr std::size_t kPiece = 64;
  std::vector<Worst> worst((ids.size() + kPiece - 1) / kPiece);
  in_parallel(worst.size(), [&](std::size_t p) {
    for (std::size_t i = p * kPiece; i < std::min((p + 1) * kPiece, ids.size()); ++i)
      if (const auto seen = in_view_.find(ids[i]); seen != in_view_.end())
        around(ids[i], [&](const Beside& at) {
          const BlockId* neighbour = covering(at.lat, at.lon, ids[i].level);
          const double error = neighbour && follows(ids[i], *neighbour, at) ? errors_of(*neighbour).all_m : 0;
          worst[p].error_m = std::max(worst[p].error_m, error);
          worst[p].error_px = std::max(worst[p].error_px, error * seen->second);
        });
  });
  for (const Worst& w : worst) {
    result_.error_m = std::max(result_.error_m, w.error_m);
    result_.error_px = std::max(result_.error_px, w.error_px);
  }
}

void ViewSelector::note_void(const BlockId& id) {
  if (!terrain_.has_replacements() || !terrain_.has_data(id) || !terrain_.node_is_cheap(id)) return;
  if (may_see(loose_bounds(id))) note_replaced(id);
}

void ViewSelector::note_replaced(const BlockId& id) {
  const std::vector<dem::SourceIndex> here = terrain_.node(id, stop_).replaced;
  result_.replaced.insert(result_.replaced.end(), here.begin(), here.end());
}

void ViewSelector::note_replacements() {
  if (!terrain_.has_replacements()) return;
  for (const BlockId& id : result_.blocks) note_replaced(id);
  std::sort(result_.replaced.begin(), result_.replaced.end());
  result_.replaced.erase(std::unique(result_.replaced.begin(), result_.replaced.end()), result_.replaced.end());
}

void ViewSelector::check_size() const {
  std::size_t needed = 0;
  for (const BlockId& id : result_.blocks) needed += scene_bytes_of(id, room_.visibility);
  if (needed > room_.bytes)
    throw TooMuchTerrain(fmt::format("the view needs {} MB for its terrain, {} MB are allowed: ask for a larger {} "
                                     "or a narrower view",
                                     needed >> 20, room_.bytes >> 20, wanting()),
                         wanting());
}

}  // namespace selenograph::engine
