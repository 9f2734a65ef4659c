#include "engine/scene/view_selector.h"

#include <fmt/format.h>

#include <cmath>

#include "dem/base/error.h"
#include "dem/detail/detailed_terrain.h"

namespace selenograph::engine {
namespace {

using dem::BlockId;

// Returns the error, m, of a finest block that a finer neighbour has split. Its children follow the sphere more closely
// than the finest surface does: heights linear in the angle are not linear along the chord. Along a slope m the
// difference is the chords' sag times 1 + 2 m^2; the factor 7 holds for slopes of up to 60 degrees.
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
                           const SceneBudget& budget, const StopToken& stop, const std::vector<Ball>& receivers)
    : terrain_(terrain), views_(views), accuracy_(accuracy), budget_(budget), stop_(stop), receivers_(receivers) {
  if (!terrain.detailed() || !can_relax(accuracy)) return;
  double pixels = 0;
  for (const ViewBundle& view : views)
    pixels = std::max(pixels, static_cast<double>(view.view.camera().width) * view.view.camera().height);
  constexpr double kMax = 3000;  // blocks, for huge images
  max_detail_blocks_ = static_cast<std::size_t>(std::min(
      Accuracy::max_detail_triangles(pixels) / static_cast<double>(dem::triangles_of_block(dem::kMaxLevel)), kMax));
  max_detail_in_view_ = max_detail_blocks_ / 5 * 4;
}

// Runs the stages of level_of_detail.md. The blocks in view stay in visible_blocks_ until shadows have refined them;
// `choose` then moves them to the selection, which balance() may split.
Selection ViewSelector::select(const Sun* sun) {
  visit_roots();
  visit_detail();
  if (sun) refine_for_shadows(*sun);
  for (const VisibleBlock& block : visible_blocks_) {
    count_detail(block.id, -1);
    choose(block.id, block.info.max_m);
  }
  balance();
  report();
  result_.blocks.assign(chosen_.begin(), chosen_.end());
  std::sort(result_.blocks.begin(), result_.blocks.end());
  find_coarser_neighbours();
  check_size();
  record_replacements();
  return std::move(result_);
}

ViewSelector::BlockView ViewSelector::view_block(const BlockId& id) const {
  if (!may_matter(terrain_, id, stop_, [&](const NodeBounds& b) { return may_be_visible(b); }))
    return {CullResult::out_of_view};
  // Reject by the outline first: it needs no block to be made.
  if (const auto outline = dem::outline(terrain_, id, stop_)) {
    const NodeBounds b = bounds_of_all(id, static_cast<double>(outline->min_m), static_cast<double>(outline->max_m));
    if (!may_be_visible(b)) return {CullResult::out_of_view};
    if (must_refine(id, *outline, b))
      return {CullResult::in_view, VisibleBlock{id, *outline, b, pixels_per_metre(b)}, true};
  }
  const auto node = bounded_node(terrain_, id, stop_);
  if (!node) return {CullResult::no_data};
  if (!may_be_visible(node->bounds)) return {CullResult::out_of_view};
  BlockView view{CullResult::in_view, visible_block(id, *node)};
  view.visible->pixels_per_metre = pixels_per_metre(node->bounds);
  return view;
}

ViewSelector::VisibleBlock ViewSelector::visible_block(const BlockId& id, const BoundedNode& node) const {
  VisibleBlock block{id, node.info, node.bounds, 0, is_finest(id)};
  if (block.is_finest)
    block.errors = Errors{};
  else if (!node.loose)
    block.errors = errors_of(id, node.info);
  return block;
}

void ViewSelector::QuadtreeSlice::record(const BlockId& id, CullResult cull) {
  if (cull == CullResult::out_of_view) out_of_view.push_back(id);
  if (cull == CullResult::no_data) without_data.push_back(id);
}

void ViewSelector::QuadtreeSlice::append(QuadtreeSlice&& next) {
  const auto join = [](auto& to, auto& from) {
    to.insert(to.end(), std::make_move_iterator(from.begin()), std::make_move_iterator(from.end()));
  };
  join(visible, next.visible);
  join(out_of_view, next.out_of_view);
  join(without_data, next.without_data);
  join(pending_detail, next.pending_detail);
  join(occluders, next.occluders);
  shadow_error_px = std::max(shadow_error_px, next.shadow_error_px);
}

void ViewSelector::merge(QuadtreeSlice&& slice) {
  for (const VisibleBlock& block : slice.visible) add_visible(block);
  out_of_view_.insert(out_of_view_.end(), slice.out_of_view.begin(), slice.out_of_view.end());
  for (const BlockId& id : slice.without_data) record_void(id);
  pending_detail_.insert(pending_detail_.end(), slice.pending_detail.begin(), slice.pending_detail.end());
  for (const auto& [id, highest_m] : slice.occluders) choose(id, highest_m);
  result_.shadow_error_px = std::max(result_.shadow_error_px, slice.shadow_error_px);
}

// Returns true unless the bounds are out of the view by their sphere, by their points, or behind the solid Moon.
bool ViewSelector::may_be_visible(const ViewBundle& view, const NodeBounds& b) {
  return view.may_see(b.centre, b.radius_m) && view.may_see(b.points, b.bulge_m) &&
         !below_horizon(view.view.position(), b, view.shift_m);
}

bool ViewSelector::may_be_visible(const NodeBounds& b) const {
  return std::any_of(views_.begin(), views_.end(), [&](const ViewBundle& view) { return may_be_visible(view, b); });
}

double ViewSelector::pixels_per_metre(const NodeBounds& b) const {
  double max_pixels_per_metre = 0;
  // The caller has found the bounds in view, so a single view needs no test.
  for (const ViewBundle& view : views_)
    if (views_.size() == 1 || may_be_visible(view, b))
      max_pixels_per_metre =
          std::max(max_pixels_per_metre, view.pixels_per_metre(b.centre, b.radius_m, b.high_m + b.bulge_m));
  return max_pixels_per_metre;
}

// Visits all roots of the quadtree that may be in view, each by a slice of its own.
void ViewSelector::visit_roots() {
  std::vector<BlockId> roots;
  for (const RootGroup& group : root_groups()) {
    const NodeBounds& b = group.bounds;
    if (!may_be_visible(b))
      groups_out_of_view_.push_back(&group);
    else
      for_each_root(terrain_, group, [&](const BlockId& id) { roots.push_back(id); });
  }
  std::sort(roots.begin(), roots.end());
  visit_slices(roots.size(), 1, [&](std::size_t i, QuadtreeSlice& slice) { visit(roots[i], slice); });
}

void ViewSelector::visit(const BlockId& id, QuadtreeSlice& slice) const {
  stop_.check();
  BlockView view = view_block(id);
  slice.record(id, view.cull);
  if (!view.visible) return;
  if (!needs_refinement(*view.visible)) {
    count_block();
    slice.visible.push_back(std::move(*view.visible));
    return;
  }
  const std::vector<BlockId> children = dem::children_of(id);
  const auto visit_child = [&](const BlockId& child, QuadtreeSlice& child_slice) {
    if (dem::has_detail(terrain_, child))
      request_refinement(child, view.visible->info, child_slice);
    else
      visit(child, child_slice);
  };
  // Split the traversal above this level: the few roots in view would leave threads idle.
  constexpr int kSplitLevels = 3;
  if (id.level >= dem::kRootLevel + kSplitLevels || children.size() == 1) {
    for (const BlockId& child : children) visit_child(child, slice);
    return;
  }
  std::vector<QuadtreeSlice> child_slices(children.size());
  in_parallel(children.size(), [&](std::size_t i) { visit_child(children[i], child_slices[i]); });
  for (QuadtreeSlice& child_slice : child_slices) slice.append(std::move(child_slice));
}

void ViewSelector::request_refinement(const BlockId& child, const dem::NodeInfo& parent, QuadtreeSlice& slice) const {
  (may_be_visible(bounds_within(child, parent)) ? slice.pending_detail : slice.out_of_view).push_back(child);
}

// Visits the queued blocks of detail and, wave by wave, those of their descendants that are needed.
void ViewSelector::visit_detail() {
  struct Evaluation {
    BlockView block;
    bool must_refine = false;
  };
  in_waves(
      std::exchange(pending_detail_, {}), max_detail_in_view_,
      [&](const BlockId& id) {
        Evaluation evaluation{view_block(id)};
        const BlockView& block = evaluation.block;
        evaluation.must_refine = block.too_coarse || (block.visible && needs_refinement(*block.visible));
        return evaluation;
      },
      [&](const BlockId& id, const Evaluation& evaluation, std::vector<BlockId>& next) {
        accept_block(id, evaluation.block, evaluation.must_refine, {}, next);
      });
}

void ViewSelector::accept_block(const BlockId& id, const BlockView& block, bool must_refine, QuadtreeSlice slice,
                                std::vector<BlockId>& next) {
  slice.record(id, block.cull);
  if (block.visible && must_refine)
    for (const BlockId& child : dem::children_of(id)) request_refinement(child, block.visible->info, slice);
  else if (block.visible)
    slice.visible.push_back(*block.visible);
  next.insert(next.end(), slice.pending_detail.begin(), slice.pending_detail.end());
  slice.pending_detail.clear();
  merge(std::move(slice));
}

void ViewSelector::add_visible(const VisibleBlock& block) {
  count_detail(block.id, 1);
  visible_blocks_.push_back(block);
}

void ViewSelector::count_detail(const BlockId& id, std::ptrdiff_t change) {
  if (max_detail_blocks_ == kUnlimited || !dem::has_detail(terrain_, id)) return;
  detail_block_count_ += static_cast<std::size_t>(change);
  if (detail_block_count_ > max_detail_blocks_) throw TooMuchDetail();
}

// Sums the parts of the error; level_of_detail.md lists them. A block's steepest slope is at most its height range over
// one post spacing.
ViewSelector::Errors ViewSelector::errors_of(const BlockId& id, const dem::NodeInfo& info) {
  const double steepest = std::max(static_cast<double>(info.max_m - info.min_m) / dem::post_spacing_m(id.level), 0.0);
  return {info.error_m + dem::chord_sag_m(id.level) + dem::parallel_shift_m(id) * steepest, info.detail_error_m,
          info.left_out_size_m, static_cast<double>(info.max_m)};
}

ViewSelector::Errors ViewSelector::errors_of(const BlockId& id) const {
  return is_finest(id) ? Errors{} : errors_of(id, terrain_.node(id, stop_));
}

bool ViewSelector::needs_refinement(const VisibleBlock& block) const {
  if (block.is_finest) return false;
  const BlockId& id = block.id;
  const double pixels_per_metre = block.pixels_per_metre;
  const double target_px = accuracy_.max_error_px;
  if (target_px == 0) return true;
  const bool coarser_than_posts = !dem::has_detail(terrain_, id) && id.level < terrain_.plain().posts_level(id);
  if (coarser_than_posts && dem::post_spacing_m(id.level) * pixels_per_metre > 2 * target_px) return true;
  // If the sag alone exceeds the target, refine without the posts' error, which may have to be computed.
  if (dem::chord_sag_m(id.level) * pixels_per_metre > target_px) return true;
  return exceeds_target(id, errors_of(block), pixels_per_metre);
}

// Over terrain with detail, an error that comes from detail counts only if the detail is large enough to be visible.
bool ViewSelector::exceeds_target(const BlockId& id, const Errors& errors, double pixels_per_metre) const {
  const double error_px = errors.total_m * pixels_per_metre, target_px = accuracy_.max_error_px;
  if (error_px <= target_px || !terrain_.detailed()) return error_px > target_px;
  const double detail_px = errors.detail_m * pixels_per_metre;
  return error_px - detail_px > target_px || hides_visible_detail(id, errors, pixels_per_metre);
}

bool ViewSelector::must_refine(const BlockId& id, const dem::NodeInfo& outline, const NodeBounds& bounds) const {
  if (accuracy_.max_error_px == 0) return true;
  // Take a lower bound of the scale in the most demanding view: if that asks for refinement, so does every block within
  // the outline.
  double min_pixels_per_metre = 0;
  for (const ViewBundle& view : views_)
    min_pixels_per_metre =
        std::max(min_pixels_per_metre, view.view.least_pixels_per_metre(bounds.centre, bounds.radius_m));
  // The greatest height is seen most obliquely.
  const Errors errors{outline.error_m, outline.detail_error_m, outline.left_out_size_m, bounds.high_m};
  return errors.total_m * min_pixels_per_metre > accuracy_.max_error_px &&
         hides_visible_detail(id, errors, min_pixels_per_metre);
}

bool ViewSelector::hides_visible_detail(const BlockId& id, const Errors& errors, double pixels_per_metre) const {
  const double size_px = errors.left_out_size_m * pixels_per_metre;
  const double min_shown_px = Accuracy::kSmallestShown * accuracy_.max_detail_error_px;
  return size_px > min_shown_px && size_px * foreshortening(id, errors.highest_m) > min_shown_px;
}

double ViewSelector::foreshortening(const BlockId& id, double highest_m) const {
  const dem::BlockExtent extent = dem::extent_of(id);
  const Geographic middle{dem::lat_deg_of(extent.lat0 + (extent.lat1() - extent.lat0) / 2),
                          dem::lon_deg_of(extent.lon0 + (extent.lon1() - extent.lon0) / 2), highest_m};
  const Vec3 middle_m = to_cartesian(middle), up = middle_m.normalized();
  // Beyond 87 degrees of emission, slopes face the camera.
  constexpr double kGrazing = 0.05;
  double max_cosine = kGrazing;
  for (const ViewBundle& view : views_)
    max_cosine = std::max(max_cosine, (view.view.position() - middle_m).normalized().dot(up));
  return std::sqrt(max_cosine);
}

void ViewSelector::choose(const BlockId& id, float highest_m) {
  if (chosen_.insert(id).second) count_detail(id, 1);
  result_.highest_m = std::max(result_.highest_m, static_cast<double>(highest_m));
}

double ViewSelector::expected_m(const Errors& errors) const {
  if (!terrain_.detailed() || errors.detail_m == 0) return errors.total_m;
  const double left_out_m = terrain_.detailed()->detail().expected_left_out_m(errors.left_out_size_m);
  return errors.total_m + std::min(errors.detail_m, left_out_m) - errors.detail_m;
}

BlockError ViewSelector::expected_error_of(const VisibleBlock& block, const Errors& errors) const {
  const double error_m = expected_m(errors);
  const NodeBounds& b = block.bounds;
  double max_sine = 0, max_cosine = 0;
  for (const ViewBundle& view : views_) {
    const Vec3& camera_m = view.view.position();
    max_sine = std::max(max_sine, largest_sine_of_emission(camera_m, b.centre, b.radius_m));
    max_cosine = std::max(max_cosine, (camera_m - b.centre).normalized().dot(b.centre.normalized()));
  }
  // Approximate the covered image area by the block's area, foreshortened by the emission angle.
  const dem::BlockExtent e = dem::extent_of(block.id);
  const double side_m = e.quads * dem::post_spacing_m(block.id.level),
               area_m2 =
                   side_m * side_m * e.lon_step / e.lat_step * std::hypot(b.centre.x(), b.centre.y()) / b.centre.norm();
  const double pixels = area_m2 * std::max(max_cosine, 0.05) * block.pixels_per_metre * block.pixels_per_metre;
  return {pixels, error_m, error_m * max_sine * block.pixels_per_metre};
}

// Sets the reported errors and spacings: over the blocks in view, then over coarser neighbours at their edges.
void ViewSelector::report() {
  std::vector<BlockError> expected;
  expected.reserve(visible_blocks_.size());
  if (!visible_blocks_.empty()) result_.min_spacing_m = std::numeric_limits<double>::infinity();
  for (const VisibleBlock& block : visible_blocks_) {
    // A finest block that a neighbour has split has the error of its children.
    const bool split = block.is_finest && !chosen_.contains(block.id);
    const Errors errors = split ? Errors{.total_m = subdivision_error_m(block.id.level)} : errors_of(block);
    const double spacing = dem::post_spacing_m(block.id.level);
    result_.error_m = std::max(result_.error_m, errors.total_m);
    result_.error_px = std::max(result_.error_px, errors.total_m * block.pixels_per_metre);
    expected.push_back(expected_error_of(block, errors));
    if (terrain_.detailed())
      result_.detail_error_px = std::max(result_.detail_error_px, errors.detail_m * block.pixels_per_metre);
    result_.min_spacing_m = std::min(result_.min_spacing_m, spacing);
    result_.max_spacing_m = std::max(result_.max_spacing_m, spacing);
    result_.max_pixels_per_metre = std::max(result_.max_pixels_per_metre, block.pixels_per_metre);
    result_.max_spacing_px = std::max(result_.max_spacing_px, spacing * block.pixels_per_metre);
  }
  result_.expected_error_px = expected_error(expected, &BlockError::error_px);
  result_.expected_error_m = expected_error(std::move(expected), &BlockError::error_m);
  // Include the errors of coarser neighbours out of view whose vertices an edge in view follows.
  const std::vector<BlockId> ids(chosen_.begin(), chosen_.end());
  struct Worst {
    double error_m = 0, error_px = 0;
  };
  constexpr std::size_t kPiece = 64;
  std::vector<Worst> worst((ids.size() + kPiece - 1) / kPiece);
  in_parallel(worst.size(), [&](std::size_t piece_index) {
    for (std::size_t i = piece_index * kPiece; i < std::min((piece_index + 1) * kPiece, ids.size()); ++i)
      if (const auto visible = in_view_.find(ids[i]); visible != in_view_.end())
        for_each_neighbour(ids[i], [&](const NeighbourProbe& probe) {
          const BlockId* neighbour = covering(probe.lat, probe.lon, ids[i].level);
          const double error = neighbour && edge_follows(ids[i], *neighbour, probe) ? errors_of(*neighbour).total_m : 0;
          worst[piece_index].error_m = std::max(worst[piece_index].error_m, error);
          worst[piece_index].error_px = std::max(worst[piece_index].error_px, error * visible->second);
        });
  });
  for (const Worst& piece : worst) {
    result_.error_m = std::max(result_.error_m, piece.error_m);
    result_.error_px = std::max(result_.error_px, piece.error_px);
  }
}

void ViewSelector::record_void(const BlockId& id) {
  if (!terrain_.plain().has_replacements() || !terrain_.has_data(id) || !dem::node_is_cheap(terrain_, id)) return;
  if (may_be_visible(loose_bounds(id))) record_replaced(id);
}

void ViewSelector::record_replaced(const BlockId& id) {
  const std::vector<dem::SourceIndex> replaced = terrain_.node(id, stop_).replaced;
  result_.replaced.insert(result_.replaced.end(), replaced.begin(), replaced.end());
}

void ViewSelector::record_replacements() {
  if (!terrain_.plain().has_replacements()) return;
  for (const BlockId& id : result_.blocks) record_replaced(id);
  std::sort(result_.replaced.begin(), result_.replaced.end());
  result_.replaced.erase(std::unique(result_.replaced.begin(), result_.replaced.end()), result_.replaced.end());
}

void ViewSelector::check_size() const {
  std::size_t needed = 0;
  for (const BlockId& id : result_.blocks) needed += scene_bytes_of(id, budget_.visibility);
  if (needed > budget_.bytes)
    throw TooMuchTerrain(fmt::format("the view needs {} MB for its terrain, {} MB are allowed: ask for a larger {} "
                                     "or a narrower view",
                                     needed >> 20, budget_.bytes >> 20, limiting_setting()),
                         limiting_setting());
}

}  // namespace selenograph::engine
