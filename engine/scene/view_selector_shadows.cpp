#include <cmath>

#include "engine/scene/view_selector.h"

namespace selenograph::engine {
namespace {

using dem::BlockId;

// 1 / tan of the Sun's elevation over the lowest place of a node: how far a shadow's edge on level ground moves per
// metre of height. Below a hundredth of a degree shadows have no edge to speak of; at a high Sun slopes still move
// them.
double shadow_gain(const NodeBounds& b, const Vec3& sun) {
  constexpr double kLeast = 1, kMost = 5700;
  const double up = std::asin(std::clamp(sun.dot(b.centre) / b.centre.norm(), -1.0, 1.0));
  const double lowest = up - std::asin(std::min(1.0, b.radius_m / b.centre.norm()));
  return lowest <= 0 ? kMost : std::clamp(1 / std::tan(lowest), kLeast, kMost);
}

}  // namespace

void ViewSelector::sharpen_shadows(const Sun& sun) {
  Vec3 middle = Vec3::Zero();
  for (const Seen& s : seen_) middle += s.bounds.centre.normalized();
  LightTree receivers(sun, middle);
  for (const Seen& s : seen_) {
    receivers.add_receiver(s.bounds, s.pixels_per_metre * shadow_gain(s.bounds, sun.direction));
    receivers_pixels_per_metre_ = std::max(receivers_pixels_per_metre_, s.pixels_per_metre);
  }
  for (const Ball& ball : receivers_) {
    double sharpness = 0;
    for (const ViewBundle& view : views_)
      if (view.may_see(ball.centre_m, ball.radius_m))
        sharpness = std::max(sharpness, view.pixels_per_metre(ball.centre_m, ball.radius_m));
    if (sharpness == 0) continue;
    const NodeBounds bounds = bounds_around(ball.centre_m, ball.radius_m);
    receivers.add_receiver(bounds, std::min(kSharpest, sharpness) * shadow_gain(bounds, sun.direction));
    receivers_pixels_per_metre_ = std::max(receivers_pixels_per_metre_, std::min(kSharpest, sharpness));
  }
  receivers.finish();
  of_detail_ = 0;
  constexpr std::size_t kPiece = 32;
  const std::vector<Seen> seen = std::exchange(seen_, {});
  take_all(seen.size(), kPiece, [&](std::size_t i, Part& part) { sharpen(seen[i], receivers, part); });
  sharpen_detail(receivers);
  std::vector<BlockId> beside = std::exchange(out_of_view_, {});
  for (const RootGroup* group : groups_out_of_view_)
    if (receivers.shaded_pixels_per_metre(group->bounds) > 0)
      for_each_root(terrain_, *group, [&](const BlockId& id) { beside.push_back(id); });
  take_all(beside.size(), kPiece, [&](std::size_t i, Part& part) {
    const BlockId& id = beside[i];
    if (!terrain_.has_detail(id)) return cast(id, receivers, part);
    const BlockId parent = dem::ancestor_of(id, id.level - 1);
    const auto outline = terrain_.outline(parent, stop_);
    want_caster(id, outline ? *outline : terrain_.node(parent, stop_), receivers, part.of_detail);
  });
  cast_detail(std::exchange(of_detail_in_view_, {}), receivers);
}

double ViewSelector::displaced_px(double error_m, double displaced_pixels_per_metre) const {
  return std::min(error_m * displaced_pixels_per_metre,
                  std::sqrt(2 * kMoonRadius_m * error_m) * receivers_pixels_per_metre_);
}

double ViewSelector::error_for_shadows_m(double displaced_pixels_per_metre) const {
  const double at_horizon_m = accuracy_.max_shadow_error_px / receivers_pixels_per_metre_;
  return std::max(accuracy_.max_shadow_error_px / displaced_pixels_per_metre,
                  at_horizon_m * at_horizon_m / (2 * kMoonRadius_m));
}

ViewSelector::Blur ViewSelector::blur(const Seen& seen, double displaced_pixels_per_metre) const {
  if (displaced_pixels_per_metre == 0 || seen.finest) return {};
  if (accuracy_.max_error_px == 0) return {true};
  // The error of a block far coarser than its posts has to be built first, with all that is beneath. Where it would
  // have to be less than a 16th of the spacing, finer blocks are taken without asking: they do as well.
  constexpr double kWorthAsking = 16;
  if (!seen.errors &&
      dem::post_spacing_m(seen.id.level) > kWorthAsking * error_for_shadows_m(displaced_pixels_per_metre))
    return {true};
  const double displaced = displaced_px(errors_of(seen).all_m, displaced_pixels_per_metre);
  return {displaced > accuracy_.max_shadow_error_px, displaced};
}

bool ViewSelector::too_much(const Blur& blur, Part& part) const {
  if (blur.too_much && accuracy_.max_error_px > 0) refined_for_shadows_ = true;
  if (!blur.too_much) part.shadow_error_px = std::max(part.shadow_error_px, blur.displaced_px);
  return blur.too_much;
}

void ViewSelector::sharpen(const Seen& seen, const LightTree& receivers, Part& part) const {
  if (!too_much(blur(seen, receivers.shaded_pixels_per_metre(seen.bounds)), part)) {
    count_block();
    part.seen.push_back(seen);
    return;
  }
  for (const BlockId& child : dem::children_of(seen.id)) {
    if (terrain_.has_detail(child)) {
      want_detail(child, seen.info, part);
      continue;
    }
    stop_.check();
    const Looked looked = looked_at(child);
    part.note(child, looked.look);
    if (looked.seen) sharpen(*looked.seen, receivers, part);
  }
}

void ViewSelector::sharpen_detail(const LightTree& receivers) {
  struct Judged {
    Looked looked;
    Blur blur{};
  };
  in_waves(
      std::exchange(of_detail_in_view_, {}), most_of_detail_,
      [&](const BlockId& id) {
        Judged judged{looked_at(id)};
        if (const auto& seen = judged.looked.seen; seen && !judged.looked.too_coarse)
          judged.blur = blur(*seen, receivers.shaded_pixels_per_metre(seen->bounds));
        return judged;
      },
      [&](const BlockId& id, const Judged& judged, std::vector<BlockId>& next) {
        Part part;
        const bool finer = judged.looked.too_coarse || (judged.looked.seen && too_much(judged.blur, part));
        take_detail(id, judged.looked, finer, std::move(part), next);
      });
}

ViewSelector::Caster ViewSelector::caster(const BlockId& id, const LightTree& receivers) const {
  if (!may_matter(terrain_, id, stop_, [&](const NodeBounds& b) { return receivers.shaded_pixels_per_metre(b) > 0; }))
    return {};
  if (const auto outline = terrain_.outline(id, stop_)) {
    const double displaced = receivers.shaded_pixels_per_metre(
        bounds_of_all(id, static_cast<double>(outline->min_m), static_cast<double>(outline->max_m)));
    if (displaced == 0) return {};
    // Wider bounds shade more than the block does.
    constexpr double kSurely = 4;
    if (accuracy_.max_error_px == 0 ||
        displaced_px(outline->error_m, displaced) > kSurely * accuracy_.max_shadow_error_px)
      return {true, false, *outline, Blur{true}};
  }
  const auto node = known(terrain_, id, stop_);
  if (!node) return {};
  const double displaced = receivers.shaded_pixels_per_metre(node->bounds);
  if (displaced == 0) return {};
  // The bounds of a large block whose heights are unknown overlap much that it does not shade: split it until its
  // bounds mean something, before its pyramid is built for its error.
  const Seen seen = seen_of(id, *node);
  if (node->loose && id.level < dem::kRootLevel + 1) return {true, true, node->info};
  return {true, false, node->info, blur(seen, displaced)};
}

void ViewSelector::cast(const BlockId& id, const LightTree& receivers, Part& part) const {
  stop_.check();
  const Caster judged = caster(id, receivers);
  if (!take_caster(id, judged, part)) return;
  for (const BlockId& child : dem::children_of(id))
    if (terrain_.has_detail(child))
      want_caster(child, judged.info, receivers, part.of_detail);
    else
      cast(child, receivers, part);
}

void ViewSelector::want_caster(const BlockId& child, const dem::NodeInfo& parent, const LightTree& receivers,
                               std::vector<BlockId>& wanted) {
  if (receivers.shaded_pixels_per_metre(bounds_within(child, parent)) > 0) wanted.push_back(child);
}

void ViewSelector::cast_detail(std::vector<BlockId> wave, const LightTree& receivers) {
  in_waves(
      std::move(wave), most_of_detail_, [&](const BlockId& id) { return caster(id, receivers); },
      [&](const BlockId& id, const Caster& judged, std::vector<BlockId>& next) {
        Part part;
        if (take_caster(id, judged, part))
          for (const BlockId& child : dem::children_of(id)) want_caster(child, judged.info, receivers, next);
        take(std::move(part));
      });
}

bool ViewSelector::take_caster(const BlockId& id, const Caster& caster, Part& part) const {
  if (!caster.matters) return false;
  if (caster.too_coarse || too_much(caster.blur, part)) return true;
  count_caster();
  part.casters.emplace_back(id, caster.info.max_m);
  return false;
}

}  // namespace selenograph::engine
