// Refines blocks until shadows are as exact as requested, and adds occluders out of view.

#include <cmath>

#include "engine/scene/view_selector.h"

namespace selenograph::engine {
namespace {

using dem::BlockId;

// Returns how far a shadow's edge on level ground moves per metre of height: 1 / tan of the Sun's lowest elevation over
// a node. Below a hundredth of a degree shadows have no edge to speak of; under a high Sun slopes still move them.
double shadow_gain(const NodeBounds& b, const Vec3& sun) {
  constexpr double kMin = 1, kMax = 5700;
  const double elevation = std::asin(std::clamp(sun.dot(b.centre) / b.centre.norm(), -1.0, 1.0));
  const double lowest = elevation - std::asin(std::min(1.0, b.radius_m / b.centre.norm()));
  return lowest <= 0 ? kMax : std::clamp(1 / std::tan(lowest), kMin, kMax);
}

}  // namespace

// Collects the receivers: blocks and objects in view, each with the pixels that a shadow's edge on it moves per metre
// of height error. Then refines the blocks in view, and last visits the terrain out of view.
void ViewSelector::refine_for_shadows(const Sun& sun) {
  Vec3 mean_vertical = Vec3::zero();
  for (const VisibleBlock& block : visible_blocks_) mean_vertical += block.bounds.centre.normalized();
  LightTree receivers(sun, mean_vertical);
  for (const VisibleBlock& block : visible_blocks_) {
    receivers.add_receiver(block.bounds, block.pixels_per_metre * shadow_gain(block.bounds, sun.direction));
    max_receiver_pixels_per_metre_ = std::max(max_receiver_pixels_per_metre_, block.pixels_per_metre);
  }
  for (const Ball& ball : receivers_) {
    double pixels_per_metre = 0;
    for (const ViewBundle& view : views_)
      if (view.may_see(ball.centre_m, ball.radius_m))
        pixels_per_metre = std::max(pixels_per_metre, view.pixels_per_metre(ball.centre_m, ball.radius_m));
    if (pixels_per_metre == 0) continue;
    const NodeBounds bounds = bounds_around(ball.centre_m, ball.radius_m);
    receivers.add_receiver(
        bounds, std::min(kMaxPixelsPerMetreOfObjects, pixels_per_metre) * shadow_gain(bounds, sun.direction));
    max_receiver_pixels_per_metre_ =
        std::max(max_receiver_pixels_per_metre_, std::min(kMaxPixelsPerMetreOfObjects, pixels_per_metre));
  }
  receivers.finish();
  detail_block_count_ = 0;
  constexpr std::size_t kGrain = 32;
  const std::vector<VisibleBlock> visible = std::exchange(visible_blocks_, {});
  visit_slices(visible.size(), kGrain,
               [&](std::size_t i, QuadtreeSlice& slice) { refine_for_shadows(visible[i], receivers, slice); });
  refine_detail_for_shadows(receivers);
  std::vector<BlockId> culled = std::exchange(out_of_view_, {});
  for (const RootGroup* group : groups_out_of_view_)
    if (receivers.shaded_pixels_per_metre(group->bounds) > 0)
      for_each_root(terrain_, *group, [&](const BlockId& id) { culled.push_back(id); });
  visit_slices(culled.size(), kGrain, [&](std::size_t i, QuadtreeSlice& slice) {
    const BlockId& id = culled[i];
    if (!dem::has_detail(terrain_, id)) return visit_occluder(id, receivers, slice);
    const BlockId parent = dem::ancestor_of(id, id.level - 1);
    const auto outline = dem::outline(terrain_, parent, stop_);
    request_occluder(id, outline ? *outline : terrain_.node(parent, stop_), receivers, slice.pending_detail);
  });
  visit_detail_occluders(std::exchange(pending_detail_, {}), receivers);
}

double ViewSelector::shadow_shift_px(double error_m, double shift_px_per_m) const {
  return std::min(error_m * shift_px_per_m, std::sqrt(2 * kMoonRadius_m * error_m) * max_receiver_pixels_per_metre_);
}

// Inverts shadow_shift_px() for the target: the larger of the errors that either of its two bounds permits.
double ViewSelector::max_error_for_shadows_m(double shift_px_per_m) const {
  const double at_horizon_m = accuracy_.max_shadow_error_px / max_receiver_pixels_per_metre_;
  return std::max(accuracy_.max_shadow_error_px / shift_px_per_m, at_horizon_m * at_horizon_m / (2 * kMoonRadius_m));
}

ViewSelector::ShadowShift ViewSelector::shadow_shift(const VisibleBlock& block, double shift_px_per_m) const {
  if (shift_px_per_m == 0 || block.is_finest) return {};
  if (accuracy_.max_error_px == 0) return {true};
  // Computing the error of a coarse block builds the whole pyramid below it. If only an error below 1/16 of the post
  // spacing would pass, refine without computing it.
  constexpr double kWorthComputing = 16;
  if (!block.errors && dem::post_spacing_m(block.id.level) > kWorthComputing * max_error_for_shadows_m(shift_px_per_m))
    return {true};
  // Judge by the expected error: the bound assumes the deepest crater everywhere, and takes three to ten times the
  // view's blocks for the same light.
  const Errors errors = errors_of(block);
  const double bound_px = shadow_shift_px(errors.total_m, shift_px_per_m);
  return {bound_px > accuracy_.max_shadow_error_px &&
              shadow_shift_px(expected_m(errors), shift_px_per_m) > accuracy_.max_shadow_error_px,
          bound_px};
}

bool ViewSelector::record_shift(const ShadowShift& shift, QuadtreeSlice& slice) const {
  if (shift.too_large && accuracy_.max_error_px > 0) refined_for_shadows_ = true;
  if (!shift.too_large) slice.shadow_error_px = std::max(slice.shadow_error_px, shift.bound_px);
  return shift.too_large;
}

void ViewSelector::refine_for_shadows(const VisibleBlock& block, const LightTree& receivers,
                                      QuadtreeSlice& slice) const {
  if (!record_shift(shadow_shift(block, receivers.shaded_pixels_per_metre(block.bounds)), slice)) {
    count_block();
    slice.visible.push_back(block);
    return;
  }
  for (const BlockId& child : dem::children_of(block.id)) {
    if (dem::has_detail(terrain_, child)) {
      request_refinement(child, block.info, slice);
      continue;
    }
    stop_.check();
    const BlockView view = view_block(child);
    slice.record(child, view.cull);
    if (view.visible) refine_for_shadows(*view.visible, receivers, slice);
  }
}

void ViewSelector::refine_detail_for_shadows(const LightTree& receivers) {
  struct Evaluation {
    BlockView block;
    ShadowShift shift{};
  };
  in_waves(
      std::exchange(pending_detail_, {}), max_detail_blocks_,
      [&](const BlockId& id) {
        Evaluation evaluation{view_block(id)};
        if (const auto& visible = evaluation.block.visible; visible && !evaluation.block.too_coarse)
          evaluation.shift = shadow_shift(*visible, receivers.shaded_pixels_per_metre(visible->bounds));
        return evaluation;
      },
      [&](const BlockId& id, const Evaluation& evaluation, std::vector<BlockId>& next) {
        QuadtreeSlice slice;
        const BlockView& block = evaluation.block;
        const bool must_refine = block.too_coarse || (block.visible && record_shift(evaluation.shift, slice));
        accept_block(id, block, must_refine, std::move(slice), next);
      });
}

ViewSelector::Occluder ViewSelector::evaluate_occluder(const BlockId& id, const LightTree& receivers) const {
  if (!may_matter(terrain_, id, stop_, [&](const NodeBounds& b) { return receivers.shaded_pixels_per_metre(b) > 0; }))
    return {};
  if (const auto outline = dem::outline(terrain_, id, stop_)) {
    const double shift_px_per_m = receivers.shaded_pixels_per_metre(
        bounds_of_all(id, static_cast<double>(outline->min_m), static_cast<double>(outline->max_m)));
    if (shift_px_per_m == 0) return {};
    // The outline's bounds are wider than the block and shade more: demand a clear excess.
    constexpr double kClearExcess = 4;
    const double error_m = expected_m({.total_m = outline->error_m,
                                       .detail_m = outline->detail_error_m,
                                       .left_out_size_m = outline->left_out_size_m});
    if (accuracy_.max_error_px == 0 ||
        shadow_shift_px(error_m, shift_px_per_m) > kClearExcess * accuracy_.max_shadow_error_px)
      return {.matters = true, .too_coarse = false, .info = *outline, .shift = {.too_large = true}};
  }
  const auto node = bounded_node(terrain_, id, stop_);
  if (!node) return {};
  const double shift_px_per_m = receivers.shaded_pixels_per_metre(node->bounds);
  if (shift_px_per_m == 0) return {};
  // Split a large block of unknown heights before its pyramid is built for its error: its bounds overlap much that it
  // does not shade.
  const VisibleBlock occluder = visible_block(id, *node);
  if (node->loose && id.level < dem::kRootLevel + 1) return {.matters = true, .too_coarse = true, .info = node->info};
  return {.matters = true, .too_coarse = false, .info = node->info, .shift = shadow_shift(occluder, shift_px_per_m)};
}

void ViewSelector::visit_occluder(const BlockId& id, const LightTree& receivers, QuadtreeSlice& slice) const {
  stop_.check();
  const Occluder evaluation = evaluate_occluder(id, receivers);
  if (!accept_occluder(id, evaluation, slice)) return;
  for (const BlockId& child : dem::children_of(id))
    if (dem::has_detail(terrain_, child))
      request_occluder(child, evaluation.info, receivers, slice.pending_detail);
    else
      visit_occluder(child, receivers, slice);
}

void ViewSelector::request_occluder(const BlockId& child, const dem::NodeInfo& parent, const LightTree& receivers,
                                    std::vector<BlockId>& pending) {
  if (receivers.shaded_pixels_per_metre(bounds_within(child, parent)) > 0) pending.push_back(child);
}

void ViewSelector::visit_detail_occluders(std::vector<BlockId> wave, const LightTree& receivers) {
  in_waves(
      std::move(wave), max_detail_blocks_, [&](const BlockId& id) { return evaluate_occluder(id, receivers); },
      [&](const BlockId& id, const Occluder& evaluation, std::vector<BlockId>& next) {
        QuadtreeSlice slice;
        if (accept_occluder(id, evaluation, slice))
          for (const BlockId& child : dem::children_of(id)) request_occluder(child, evaluation.info, receivers, next);
        merge(std::move(slice));
      });
}

bool ViewSelector::accept_occluder(const BlockId& id, const Occluder& evaluation, QuadtreeSlice& slice) const {
  if (!evaluation.matters) return false;
  if (evaluation.too_coarse || record_shift(evaluation.shift, slice)) return true;
  count_occluder();
  slice.occluders.emplace_back(id, evaluation.info.max_m);
  return false;
}

}  // namespace selenograph::engine
