#include "engine/frames/crater_rims.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <unordered_map>
#include <utility>

#include "dem/base/error.h"
#include "dem/base/parallel.h"
#include "dem/detail/detail.h"
#include "dem/detail/footprints.h"
#include "dem/detail/unloaded_blocks.h"
#include "dem/terrain/surface_place.h"
#include "engine/camera/row_views.h"
#include "engine/frame/needs.h"
#include "engine/scene/node_bounds.h"

namespace selenograph::engine {
namespace {

using std::numbers::pi;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Returns the first level that shows an octave of craters. Its blocks are 64 of the octave's smallest diameters wide.
int level_of_craters(int octave) { return dem::Detail::smallest_octave(0) - octave; }

// Blocks with detail that may be in view, of all that a frame has selected.
class BlocksInView {
 public:
  struct InView {
    std::shared_ptr<const dem::Block> block;
    double low_m, high_m;
    double px_per_m;  // upper bound
  };

  BlocksInView(const Selection& selection, const RowViews& views, const dem::Terrain& terrain, const StopToken& stop) {
    std::vector<std::optional<InView>> found(selection.blocks.size());
    in_parallel_pieces(found.size(), 8, [&](std::size_t first, std::size_t past_last) {
      for (std::size_t i = first; i < past_last; ++i) found[i] = if_in_view(selection.blocks[i], views, terrain, stop);
    });
    for (std::size_t i = 0; i < found.size(); ++i) {
      if (!found[i]) continue;
      const int level = selection.blocks[i].level;
      coarsest_ = std::min(coarsest_, level);
      finest_ = std::max(finest_, level);
      blocks_.emplace(selection.blocks[i], std::move(*found[i]));
    }
  }

  const auto& by_id() const { return blocks_; }
  // Returns the finest block at a position; null if none may be in view.
  const dem::Block* at(const Geographic& position) const {
    for (int level = finest_; level >= coarsest_; --level)
      if (const auto found = blocks_.find(dem::block_at_place(level, position.lat_deg, position.lon_deg));
          found != blocks_.end())
        return found->second.block.get();
    return nullptr;
  }

 private:
  // Returns a block with detail; empty if all views cull it.
  static std::optional<InView> if_in_view(const dem::BlockId& id, const RowViews& views, const dem::Terrain& terrain,
                                          const StopToken& stop) {
    stop.check();
    if (!dem::has_detail(terrain, id)) return std::nullopt;
    const dem::NodeInfo info = terrain.node(id, stop);
    if (info.empty) return std::nullopt;
    const NodeBounds bounds = bounds_of(id, static_cast<double>(info.min_m), static_cast<double>(info.max_m));
    double px_per_m = 0;
    for (const ViewBundle& bundle : views.bundles())
      if (bundle.may_see(bounds.points, bounds.bulge_m) &&
          !below_horizon(bundle.view.position(), bounds, bundle.shift_m))
        px_per_m = std::max(px_per_m, bundle.pixels_per_metre(bounds.centre, bounds.radius_m, bounds.high_m));
    if (px_per_m == 0) return std::nullopt;
    return InView{terrain.block(id, stop), bounds.low_m, bounds.high_m, px_per_m};
  }

  std::unordered_map<dem::BlockId, InView, dem::BlockIdHash> blocks_;
  int coarsest_ = dem::kMaxLevel, finest_ = 0;
};

// Finds the craters in view, largest first, and the outlines of their rims in the image.
class RimFinder {
 public:
  RimFinder(const FrameRequest& request, const Selection& selection, std::span<const double> range_m,
            const dem::Terrain& terrain, std::shared_ptr<const dem::CraterRoughness> roughness, const StopToken& stop)
      : options_(*request.craters),
        width_(request.camera.width),
        height_(request.camera.height),
        range_m_(range_m),
        terrain_(terrain),
        stop_(stop),
        views_(request.camera, request.pose, request.shutter, stop),
        blocks_(selection, views_, terrain, stop),
        survey_(terrain, std::move(roughness)) {}

  CraterRims find() const {
    const std::vector<dem::CraterFeature> features = in_view();
    std::vector<std::optional<CraterRim>> rims(features.size());
    std::vector<char> cut_off(features.size(), 0);
    in_parallel_pieces(features.size(), 16, [&](std::size_t first, std::size_t past_last) {
      for (std::size_t i = first; i < past_last; ++i) {
        stop_.check();
        bool is_complete = true;
        rims[i] = rim_of(features[i], is_complete);
        cut_off[i] = !is_complete;
      }
    });
    CraterRims found;
    for (auto& rim : rims)
      if (rim) found.rims.push_back(std::move(*rim));
    found.cut_off = static_cast<std::size_t>(std::count(cut_off.begin(), cut_off.end(), 1));
    return found;
  }

 private:
  // Ground to search for craters of an octave: a block of level_of_craters(octave).
  struct SearchBlock {
    int octave;
    dem::BlockId id;
    auto operator<=>(const SearchBlock&) const = default;
  };
  // Range of heights of the terrain in view.
  struct Heights {
    double low_m = std::numeric_limits<double>::infinity(), high_m = -std::numeric_limits<double>::infinity();
  };

  // Returns the ground to search, for each octave whose largest craters are large enough in the image, with the heights
  // of the blocks in view there. The map is ordered, because the order of the blocks in view is arbitrary.
  std::map<SearchBlock, Heights> search_blocks() const {
    std::map<SearchBlock, Heights> search_blocks;
    const dem::CraterField& field = survey_.field();
    for (const auto& [id, in_view] : blocks_.by_id())
      for (int k = field.smallest_octave(); k <= field.largest_octave(); ++k) {
        const int level = level_of_craters(k);
        if (level < dem::kRootLevel || level > id.level || field.largest_m(k) * in_view.px_per_m < options_.least_px)
          continue;
        Heights& heights = search_blocks[{k, dem::ancestor_of(id, level)}];
        heights.low_m = std::min(heights.low_m, in_view.low_m);
        heights.high_m = std::max(heights.high_m, in_view.high_m);
      }
    return search_blocks;
  }

  // Returns whether a crater on ground of these heights may touch the image and be large enough in it.
  bool may_show(const dem::Crater& crater, const Heights& heights) const {
    const Vec3 centre = crater.centre * (kMoonRadius_m + (heights.low_m + heights.high_m) / 2);
    const double radius_m = crater.diameter_m + (heights.high_m - heights.low_m) / 2;
    return std::any_of(views_.bundles().begin(), views_.bundles().end(), [&](const ViewBundle& bundle) {
      return bundle.may_see(centre, radius_m) &&
             crater.diameter_m * bundle.pixels_per_metre(centre, radius_m) >= options_.least_px;
    });
  }

  // Returns the craters that may be in view, largest first. Throws ImpossibleRequest if there are too many.
  std::vector<dem::CraterFeature> in_view() const {
    const std::map<SearchBlock, Heights> ordered = search_blocks();
    const std::vector<std::pair<SearchBlock, Heights>> searches(ordered.begin(), ordered.end());
    const auto search = [&](std::size_t i, auto& craters) {
      const auto& [block, heights] = searches[i];
      // Include craters whose centres are outside the block and that reach into it.
      const dem::Footprint box = dem::around(dem::footprint_of(block.id), std::ldexp(1.0, block.octave));
      const auto is_shown = [&, &heights = heights](const dem::Crater& crater) { return may_show(crater, heights); };
      survey_.craters_in(block.octave, box, options_.least_depth, is_shown, craters, stop_);
    };
    auto found = gathered_in_parallel<dem::CraterFeature>(searches.size(), 1, kMaxCraters, search);
    if (!found)
      throw ImpossibleRequest(
          fmt::format("more than {} craters are in view: ask for a larger smallest_px", kMaxCraters), "craters");
    return dem::largest_first(std::move(*found));
  }

  // Image of a point on the ground: NaN where no row sees it.
  struct ImagePoint {
    RimPoint pixel{kNaN, kNaN};
    bool visible = false;
  };
  // Projects the ground in a direction from the Moon's centre; it is visible only on a level that shows the octave.
  ImagePoint project_ground(const Vec3& direction, int octave) const {
    const Geographic at = to_geographic(direction * kMoonRadius_m);
    const dem::Block* block = blocks_.at(at);
    const int level = level_of_craters(octave);
    // Outside the image no block was selected: take a level that shows the crater.
    const auto ground = block ? dem::surface_on(*block, at.lat_deg, at.lon_deg)
                              : dem::surface_at(terrain_, at.lat_deg, at.lon_deg, level, stop_);
    ImagePoint image;
    if (!ground) return image;
    const Vec3 point_m = direction * (kMoonRadius_m + ground->height_m);
    Vec3 camera_m = views_.reference().position();
    if (views_.vary()) {
      const auto sighting = views_.find(point_m);
      if (!sighting) return image;
      image.pixel = {sighting->pixel.x, sighting->pixel.y};
      camera_m = sighting->camera_m;
    } else if (const auto pixel = views_.reference().project(point_m)) {
      image.pixel = {pixel->x, pixel->y};
    }
    const double range_m = (point_m - camera_m).norm();
    image.visible = block && block->id.level >= level &&
                    is_unobstructed(image.pixel, range_m - 1 / views_.reference().pixels_per_metre(point_m, 0));
    return image;
  }

  // Returns whether a point is no farther than what its pixel or one of the eight around it sees: at the frame's own
  // resolution nothing stands in front of it.
  bool is_unobstructed(const RimPoint& at, double range_m) const {
    if (!(at.x_px >= -0.5 && at.y_px >= -0.5 && at.x_px < width_ - 0.5 && at.y_px < height_ - 0.5)) return false;
    const int column = static_cast<int>(std::lround(at.x_px));
    const int row = static_cast<int>(std::lround(at.y_px));
    double farthest_m = 0;
    for (int y = std::max(0, row - 1); y <= std::min(height_ - 1, row + 1); ++y)
      for (int x = std::max(0, column - 1); x <= std::min(width_ - 1, column + 1); ++x) {
        const double here_m =
            range_m_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x)];
        if (std::isnan(here_m)) return true;  // the sky
        farthest_m = std::max(farthest_m, here_m);
      }
    return range_m <= farthest_m;
  }

  // Returns the rim in the image; empty if it is too small, hidden or cut off (`is_complete` false) by the image's
  // edge.
  std::optional<CraterRim> rim_of(const dem::CraterFeature& feature, bool& is_complete) const {
    const Vec3 centre = feature.crater.centre * (kMoonRadius_m + feature.location.height_m);
    const double radius_m = feature.crater.diameter_m / 2;
    double px_per_m = 0;
    for (const ViewBundle& bundle : views_.bundles())
      px_per_m = std::max(px_per_m, bundle.pixels_per_metre(centre, radius_m));
    const double radius_px = std::min(radius_m * px_per_m, 1e4);
    if (2 * radius_px < options_.least_px) return std::nullopt;
    // So many points keep the chords within a tenth of a pixel of the rim.
    const int points = std::clamp(static_cast<int>(std::ceil(pi * std::sqrt(5 * radius_px))), 24, 256);
    CraterRim rim{feature, {kNaN, kNaN}, false, {}, 0};
    const ImagePoint centre_image = project_ground(feature.crater.centre, feature.octave);
    rim.centre = centre_image.pixel;
    rim.centre_visible = centre_image.visible;
    int visible_points = 0;
    for (int i = 0; i < points; ++i) {
      const Vec3 direction = dem::CraterSurvey::on_rim(feature.crater, 2 * pi * i / points);
      const ImagePoint point = project_ground(direction, feature.octave);
      visible_points += point.visible;
      rim.outline.push_back(point.pixel);
    }
    rim.rim_visible = static_cast<double>(visible_points) / points;
    if (visible_points == 0 && !rim.centre_visible) return std::nullopt;
    is_complete =
        std::none_of(rim.outline.begin(), rim.outline.end(), [](const RimPoint& p) { return std::isnan(p.x_px); });
    if (!is_complete || diameter_px(rim.outline) < options_.least_px) return std::nullopt;
    return rim;
  }

  // Returns the diameter of the circle with the outline's area.
  static double diameter_px(const std::vector<RimPoint>& outline) {
    double double_area = 0;  // by the shoelace formula
    for (std::size_t i = 0; i < outline.size(); ++i) {
      const RimPoint &a = outline[i], &b = outline[(i + 1) % outline.size()];
      double_area += a.x_px * b.y_px - b.x_px * a.y_px;
    }
    return std::sqrt(2 * std::abs(double_area) / pi);
  }

  const RimOptions options_;
  const int width_, height_;
  std::span<const double> range_m_;
  const dem::Terrain& terrain_;
  const StopToken& stop_;
  RowViews views_;
  BlocksInView blocks_;
  dem::CraterSurvey survey_;
};

}  // namespace

RimEllipse ellipse_of(const std::vector<RimPoint>& outline) {
  const auto n = static_cast<double>(outline.size());
  RimPoint mean{0, 0};
  for (const RimPoint& p : outline) {
    mean.x_px += p.x_px / n;
    mean.y_px += p.y_px / n;
  }
  double xx = 0, xy = 0, yy = 0;  // mean squares and product of the offsets from the mean
  for (const RimPoint& p : outline) {
    const double x = p.x_px - mean.x_px, y = p.y_px - mean.y_px;
    xx += x * x / n;
    xy += x * y / n;
    yy += y * y / n;
  }
  // Along a principal axis of an ellipse the mean square over its circumference is half the squared semi-axis.
  // The mean squares along the axes, eigenvalues of the matrix of xx, xy and yy, are mean_square +- difference.
  const double mean_square = (xx + yy) / 2;
  const double difference = std::hypot((xx - yy) / 2, xy);
  return {mean, std::sqrt(2 * (mean_square + difference)), std::sqrt(2 * std::max(0.0, mean_square - difference)),
          std::atan2(2 * xy, xx - yy) / 2 * kDegreesPerRadian};
}

CraterRims crater_rims(const FrameRequest& request, const Selection& selection, std::span<const double> range_m,
                       const dem::Terrain& terrain, std::shared_ptr<const dem::CraterRoughness> roughness,
                       const StopToken& stop) {
  return RimFinder(request, selection, range_m, terrain, std::move(roughness), stop).find();
}

}  // namespace selenograph::engine
