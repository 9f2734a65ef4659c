#include "engine/crater_rims.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>
#include <numbers>
#include <optional>
#include <set>
#include <utility>

#include "dem/detail/detail.h"
#include "dem/support/parallel.h"
#include "dem/terrain/surface_place.h"
#include "engine/camera/row_views.h"
#include "engine/render_frame.h"

namespace selenograph::engine {
namespace {

using std::numbers::pi;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr std::uint16_t kNothing = 65535;

// Where the camera's pixels meet the ground, as the frame has it.
struct Ground {
  int width, height;
  std::vector<double> position, range;
  std::vector<std::uint16_t> object;  // empty: there are none
};

Ground ground_of(FrameRequest request, const dem::Terrain& terrain, RenderCache& kept, const StopToken& stop) {
  request.products = kPosition | kRange;
  if (!request.objects.empty()) request.products |= kObjectId;
  request.sensor.reset(), request.truth.reset();
  request.accuracy.samples_per_pixel = 1;
  FrameProducts products = render_frame(request, terrain, kept, stop).products;
  return {request.camera.width, request.camera.height, std::move(products.position), std::move(products.range),
          std::move(products.object_id)};
}

class RimFinder {
 public:
  RimFinder(const FrameRequest& request, const RimOptions& options, const dem::Terrain& terrain, RenderCache& kept,
            const StopToken& stop)
      : options_(options),
        terrain_(terrain),
        stop_(stop),
        views_(request.camera, request.pose, request.shutter, stop),
        ground_(ground_of(request, terrain, kept, stop)),
        survey_(terrain) {}

  CraterRims find() const {
    std::vector<dem::CraterFeature> features;
    for (int k = survey_.field().smallest_octave(); k <= survey_.field().largest_octave(); ++k)
      add_features(k, features);
    features = dem::largest_first(std::move(features));
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
  Vec3 position(std::size_t pixel) const {
    return {ground_.position[3 * pixel], ground_.position[3 * pixel + 1], ground_.position[3 * pixel + 2]};
  }

  // A piece of ground in view: what is in a cube of space.
  struct Cube {
    int x, y, z;
    auto operator<=>(const Cube&) const = default;
    Vec3 direction() const { return (Vec3(x, y, z) + Vec3::Constant(0.5)).normalized(); }
  };

  // Where craters of an octave may be large enough.
  std::set<Cube> cubes(int octave, double side_m) const {
    const double largest_m = std::ldexp(2.0, octave);
    std::set<Cube> found;
    std::mutex mutex;
    in_parallel_pieces(static_cast<std::size_t>(ground_.height), 16, [&](std::size_t first, std::size_t past_last) {
      std::set<Cube> some;
      std::optional<Cube> latest;
      const auto width = static_cast<std::size_t>(ground_.width);
      for (std::size_t i = first * width; i < past_last * width; ++i) {
        if (i % width == 0) stop_.check();
        if (std::isnan(ground_.range[i]) || (!ground_.object.empty() && ground_.object[i] != kNothing)) continue;
        const Vec3 at = position(i);
        if (largest_m * views_.of_pixel(i).pixels_per_metre(at, 0) < options_.least_px) continue;
        const Vec3 p = at.normalized() * (kMoonRadius_m / side_m);
        const Cube cube{static_cast<int>(std::floor(p.x())), static_cast<int>(std::floor(p.y())),
                        static_cast<int>(std::floor(p.z()))};
        if (cube != latest) some.insert(cube), latest = cube;
      }
      const std::lock_guard lock(mutex);
      found.merge(some);
    });
    return found;
  }

  void add_features(int octave, std::vector<dem::CraterFeature>& out) const {
    const double side_m = std::ldexp(8.0, octave);
    const std::set<Cube> found = cubes(octave, side_m);
    const std::vector<Cube> all(found.begin(), found.end());
    // From the middle of a cube, moved onto the sphere, to all in it, and to what neighbouring pixels see.
    const double around_m = (std::numbers::sqrt3 + 1) * side_m;
    const auto near = gathered_in_parallel<dem::Crater>(all.size(), 8, [&](std::size_t i, auto& some) {
      stop_.check();
      survey_.near(octave, all[i].direction(), around_m, some, stop_);
    });
    std::map<std::uint64_t, dem::Crater> craters;
    for (const dem::Crater& crater : near)
      if (crater.depth_m >= options_.least_depth * crater.diameter_m) craters.emplace(crater.id, crater);
    std::vector<dem::Crater> list;
    for (const auto& [id, crater] : craters) list.push_back(crater);
    const auto shown = gathered_in_parallel<dem::CraterFeature>(list.size(), 16, [&](std::size_t i, auto& some) {
      stop_.check();
      survey_.add_if_shown(list[i], octave, some, stop_);
    });
    out.insert(out.end(), shown.begin(), shown.end());
  }

  struct Seen {
    RimPoint pixel{kNaN, kNaN};
    bool visible = false;
  };
  Seen look(const Vec3& direction, int level) const {
    const Geographic at = to_geographic(direction * kMoonRadius_m);
    const auto ground = dem::surface_at(terrain_, at.lat_deg, at.lon_deg, level, stop_);
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
    seen.visible = visible(seen.pixel, range_m - 1 / views_.reference().pixels_per_metre(place, 0));
    return seen;
  }

  // Not farther, by more than a pixel's width, than what the pixel or one beside it sees: at the frame's own resolution
  // nothing stands before it.
  bool visible(const RimPoint& at, double range_m) const {
    if (!(at.x_px >= -0.5 && at.y_px >= -0.5 && at.x_px < ground_.width - 0.5 && at.y_px < ground_.height - 0.5))
      return false;
    const int column = static_cast<int>(std::lround(at.x_px)), row = static_cast<int>(std::lround(at.y_px));
    double farthest_m = 0;
    for (int y = std::max(0, row - 1); y <= std::min(ground_.height - 1, row + 1); ++y)
      for (int x = std::max(0, column - 1); x <= std::min(ground_.width - 1, column + 1); ++x) {
        const double here_m = ground_.range[static_cast<std::size_t>(y) * static_cast<std::size_t>(ground_.width) +
                                            static_cast<std::size_t>(x)];
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
    // Posts half a pixel apart, and no farther than what shows the crater; chords within a tenth of a pixel.
    int level = dem::kRootLevel;
    while (level < dem::kMaxLevel &&
           (dem::post_spacing_m(level) * px_per_m > 0.5 || dem::Detail::smallest_octave(level) > feature.octave))
      ++level;
    const int points = std::clamp(static_cast<int>(std::ceil(pi * std::sqrt(5 * radius_px))), 24, 256);
    CraterRim rim{feature, {kNaN, kNaN}, false, {}, 0};
    const Seen middle = look(feature.crater.centre, level);
    rim.centre = middle.pixel, rim.centre_visible = middle.visible;
    int seen = 0;
    for (int i = 0; i < points; ++i) {
      const Seen point = look(dem::CraterSurvey::on_rim(feature.crater, 2 * pi * i / points), level);
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

  const RimOptions& options_;
  const dem::Terrain& terrain_;
  const StopToken& stop_;
  RowViews views_;
  Ground ground_;
  dem::CraterSurvey survey_;
};

}  // namespace

CraterRims crater_rims(const FrameRequest& request, const RimOptions& options, const dem::Terrain& terrain,
                       RenderCache& kept, const StopToken& stop) {
  return RimFinder(request, options, terrain, kept, stop).find();
}

}  // namespace selenograph::engine
