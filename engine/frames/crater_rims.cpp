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
#include "dem/terrain/surface_place.h"
#include "engine/camera/row_views.h"
#include "engine/frame/needs.h"
#include "engine/scene/node_bounds.h"

namespace selenograph::engine {
namespace {

using std::numbers::pi;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// The first level that shows an octave of craters; its blocks are 64 of the octave's smallest diameters wide.
int level_of_craters(int octave) { return dem::Detail::smallest_octave(0) - octave; }

// The frame's blocks that may be in view.
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
      for (std::size_t i = first; i < past_last; ++i) found[i] = look_at(selection.blocks[i], views, terrain, stop);
    });
    for (std::size_t i = 0; i < found.size(); ++i) {
      if (!found[i]) continue;
      const int level = selection.blocks[i].level;
      coarsest_ = std::min(coarsest_, level), finest_ = std::max(finest_, level);
      blocks_.emplace(selection.blocks[i], std::move(*found[i]));
    }
  }

  const auto& all() const { return blocks_; }
  // The block at a place; null: none that may be in view.
  const dem::Block* at(const Geographic& place) const {
    for (int level = finest_; level >= coarsest_; --level)
      if (const auto found = blocks_.find(dem::block_at_place(level, place.lat_deg, place.lon_deg));
          found != blocks_.end())
        return found->second.block.get();
    return nullptr;
  }

 private:
  static std::optional<InView> look_at(const dem::BlockId& id, const RowViews& views, const dem::Terrain& terrain,
                                       const StopToken& stop) {
    stop.check();
    if (!terrain.has_detail(id)) return std::nullopt;
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
        bool whole = true;
        rims[i] = rim_of(features[i], whole);
        cut_off[i] = !whole;
      }
    });
    CraterRims all;
    for (auto& rim : rims)
      if (rim) all.rims.push_back(std::move(*rim));
    all.cut_off = static_cast<std::size_t>(std::count(cut_off.begin(), cut_off.end(), 1));
    return all;
  }

 private:
  // Ground to be searched for craters of an octave: a block of level_of_craters(octave), and between which heights its
  // terrain is in view.
  struct Piece {
    int octave;
    dem::BlockId id;
    auto operator<=>(const Piece&) const = default;
  };
  struct Heights {
    double low_m = std::numeric_limits<double>::infinity(), high_m = -std::numeric_limits<double>::infinity();
  };

  std::map<Piece, Heights> pieces() const {
    std::map<Piece, Heights> pieces;
    const dem::CraterField& field = survey_.field();
    for (const auto& [id, in_view] : blocks_.all())
      for (int k = field.smallest_octave(); k <= field.largest_octave(); ++k) {
        const int level = level_of_craters(k);
        if (level < dem::kRootLevel || level > id.level || field.largest_m(k) * in_view.px_per_m < options_.least_px)
          continue;
        Heights& heights = pieces[{k, dem::ancestor_of(id, level)}];
        heights.low_m = std::min(heights.low_m, in_view.low_m),
        heights.high_m = std::max(heights.high_m, in_view.high_m);
      }
    return pieces;
  }

  // Whether a crater on such ground may touch the image and be large enough.
  bool may_show(const dem::Crater& crater, const Heights& heights) const {
    const Vec3 centre = crater.centre * (kMoonRadius_m + (heights.low_m + heights.high_m) / 2);
    const double radius_m = crater.diameter_m + (heights.high_m - heights.low_m) / 2;
    return std::any_of(views_.bundles().begin(), views_.bundles().end(), [&](const ViewBundle& bundle) {
      return bundle.may_see(centre, radius_m) &&
             crater.diameter_m * bundle.pixels_per_metre(centre, radius_m) >= options_.least_px;
    });
  }

  std::vector<dem::CraterFeature> in_view() const {
    const std::map<Piece, Heights> map = pieces();
    const std::vector<std::pair<Piece, Heights>> all(map.begin(), map.end());
    auto found = gathered_in_parallel<dem::CraterFeature>(all.size(), 1, kMaxCraters, [&](std::size_t i, auto& some) {
      const Piece& piece = all[i].first;
      const Heights& heights = all[i].second;
      // With those beside it that reach into it.
      const dem::Footprint box = dem::around(dem::footprint_of(piece.id), std::ldexp(1.0, piece.octave));
      survey_.within(
          piece.octave, box, options_.least_depth, [&](const dem::Crater& crater) { return may_show(crater, heights); },
          some, stop_);
    });
    if (!found)
      throw ImpossibleRequest(
          fmt::format("more than {} craters are in view: ask for a larger smallest_px", kMaxCraters), "craters");
    return dem::largest_first(std::move(*found));
  }

  struct Seen {
    RimPoint pixel{kNaN, kNaN};
    bool visible = false;
  };
  Seen look(const Vec3& direction, int octave) const {
    const Geographic at = to_geographic(direction * kMoonRadius_m);
    const dem::Block* block = blocks_.at(at);
    const int level = level_of_craters(octave);
    // Beside the image a level that shows the crater.
    const auto ground = block ? dem::surface_on(*block, at.lat_deg, at.lon_deg)
                              : dem::surface_at(terrain_, at.lat_deg, at.lon_deg, level, stop_);
    Seen seen;
    if (!ground) return seen;
    const Vec3 place = direction * (kMoonRadius_m + ground->height_m);
    Vec3 camera_m = views_.reference().position();
    if (views_.vary()) {
      const auto sighting = views_.find(place);
      if (!sighting) return seen;
      seen.pixel = {sighting->pixel.x, sighting->pixel.y}, camera_m = sighting->camera_m;
    } else if (const auto pixel = views_.reference().project(place)) {
      seen.pixel = {pixel->x, pixel->y};
    }
    const double range_m = (place - camera_m).norm();
    seen.visible = block && block->id.level >= level &&
                   visible(seen.pixel, range_m - 1 / views_.reference().pixels_per_metre(place, 0));
    return seen;
  }

  // Not farther, by more than a pixel's width, than what the pixel or one beside it sees: at the frame's own resolution
  // nothing stands before it.
  bool visible(const RimPoint& at, double range_m) const {
    if (!(at.x_px >= -0.5 && at.y_px >= -0.5 && at.x_px < width_ - 0.5 && at.y_px < height_ - 0.5)) return false;
    const int column = static_cast<int>(std::lround(at.x_px)), row = static_cast<int>(std::lround(at.y_px));
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

  std::optional<CraterRim> rim_of(const dem::CraterFeature& feature, bool& whole) const {
    const Vec3 centre = feature.crater.centre * (kMoonRadius_m + feature.place.height_m);
    const double radius_m = feature.crater.diameter_m / 2;
    double px_per_m = 0;
    for (const ViewBundle& bundle : views_.bundles())
      px_per_m = std::max(px_per_m, bundle.pixels_per_metre(centre, radius_m));
    const double radius_px = std::min(radius_m * px_per_m, 1e4);
    if (2 * radius_px < options_.least_px) return std::nullopt;
    // Chords within a tenth of a pixel.
    const int points = std::clamp(static_cast<int>(std::ceil(pi * std::sqrt(5 * radius_px))), 24, 256);
    CraterRim rim{feature, {kNaN, kNaN}, false, {}, 0};
    const Seen middle = look(feature.crater.centre, feature.octave);
    rim.centre = middle.pixel, rim.centre_visible = middle.visible;
    int seen = 0;
    for (int i = 0; i < points; ++i) {
      const Seen point = look(dem::CraterSurvey::on_rim(feature.crater, 2 * pi * i / points), feature.octave);
      seen += point.visible;
      rim.outline.push_back(point.pixel);
    }
    rim.rim_visible = static_cast<double>(seen) / points;
    if (seen == 0 && !rim.centre_visible) return std::nullopt;
    whole = std::none_of(rim.outline.begin(), rim.outline.end(), [](const RimPoint& p) { return std::isnan(p.x_px); });
    if (!whole || diameter_px(rim.outline) < options_.least_px) return std::nullopt;
    return rim;
  }

  // Of a circle of its area.
  static double diameter_px(const std::vector<RimPoint>& outline) {
    double twice = 0;
    for (std::size_t i = 0; i < outline.size(); ++i) {
      const RimPoint &a = outline[i], &b = outline[(i + 1) % outline.size()];
      twice += a.x_px * b.y_px - b.x_px * a.y_px;
    }
    return std::sqrt(2 * std::abs(twice) / pi);
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
  for (const RimPoint& p : outline) mean.x_px += p.x_px / n, mean.y_px += p.y_px / n;
  double xx = 0, xy = 0, yy = 0;
  for (const RimPoint& p : outline) {
    const double x = p.x_px - mean.x_px, y = p.y_px - mean.y_px;
    xx += x * x / n, xy += x * y / n, yy += y * y / n;
  }
  // Along a principal axis the mean square is half the semi-axis squared.
  const double middle = (xx + yy) / 2, apart = std::hypot((xx - yy) / 2, xy);
  return {mean, std::sqrt(2 * (middle + apart)), std::sqrt(2 * std::max(0.0, middle - apart)),
          std::atan2(2 * xy, xx - yy) / 2 * kDegreesPerRadian};
}

CraterRims crater_rims(const FrameRequest& request, const Selection& selection, std::span<const double> range_m,
                       const dem::Terrain& terrain, std::shared_ptr<const dem::CraterRoughness> roughness,
                       const StopToken& stop) {
  return RimFinder(request, selection, range_m, terrain, std::move(roughness), stop).find();
}

}  // namespace selenograph::engine
