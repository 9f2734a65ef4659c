#include "engine/sky/sky_in_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "dem/base/error.h"
#include "engine/cache/render_context.h"
#include "engine/radiometry/earth.h"
#include "engine/radiometry/photometry.h"
#include "engine/radiometry/spectrum.h"
#include "engine/rays/ray_queries.h"
#include "engine/scene/ray_selection.h"
#include "engine/sensor/sensor.h"
#include "engine/sky/magnitudes.h"
#include "engine/visibility/objects/enclosed.h"

namespace selenograph::engine {
namespace {

// Returns the radius of a circle on the sky that encloses the images of all rows and a margin; pi, everything, for a
// lens that does not image the whole border.
double field_radius_rad(const RowViews& views, double margin_px) {
  const Vec3 middle = views.reference().middle();
  const Camera& camera = views.camera();
  double radius = 0;
  for (const ViewBundle& bundle : views.bundles()) {
    constexpr int kIntervals = 16;
    for (int i = 0; i <= kIntervals; ++i) {
      const double x = -0.5 - margin_px + (camera.width + 2 * margin_px) * i / kIntervals,
                   y = -0.5 - margin_px + (camera.height + 2 * margin_px) * i / kIntervals;
      for (const auto& [px, py] : {std::pair{x, -0.5 - margin_px},
                                   {x, camera.height - 0.5 + margin_px},
                                   {-0.5 - margin_px, y},
                                   {camera.width - 0.5 + margin_px, y}}) {
        const auto ray = bundle.view.ray(px, py);
        if (!ray) return std::numbers::pi;
        radius = std::max(radius, angle_between(*ray, middle) + bundle.turn_rad);
      }
    }
  }
  // Between the sampled border points a pinhole's angles grow by less than 2 %. A fisheye may image directions outside
  // those of its border: it gets the whole sky.
  return views.camera().beyond_plane() ? std::numbers::pi : 1.02 * radius;
}

// Computes an object's irradiance in the request's band, and weighted as the sensor counts photons.
class SkyLight {
 public:
  explicit SkyLight(const FrameRequest& request) : band_(band_of(request)), light_(band_) {
    if (!request.sensor) return;
    photons_ = in_photons(*band_, request.sensor->detector.efficiency);
    counted_.emplace(&*photons_);
  }
  // Sets both irradiances by value(Starlight, band), where the band is null for all wavelengths.
  template <typename Value>
  void set(SkyObject& object, const Value& value) const {
    object.irradiance_w_m2 = value(light_, band_);
    if (counted_) object.counted_w_m2 = value(*counted_, &*photons_);
  }

 private:
  const Band* band_;
  Starlight light_;
  std::optional<Band> photons_;
  std::optional<Starlight> counted_;
};

// Returns the Sun's irradiance at 1 au.
double sunlight_w_m2(const Band* band) { return band ? solar_irradiance_w_m2(*band) : kSolarConstant_w_m2; }

// Finds the objects of a frame's sky: stars near the view, then Sun, Earth and planets. With `wants_positions` each
// gets its position in the image, and stars outside the image are dropped.
class SkyFinder {
 public:
  SkyFinder(const FrameRequest& request, const RowViews& views, double margin_px, bool wants_positions)
      : request_(request),
        options_(*request.sky),
        views_(views),
        margin_px_(margin_px),
        wants_positions_(wants_positions),
        observer_(options_.utc, views.reference().position(), options_.velocity_m_s, options_.states),
        light_(request) {}

  std::vector<SkyObject> find_all(const StopToken& stop) const {
    std::vector<SkyObject> sky = stars(stop);
    add_bodies(sky);
    return sky;
  }

 private:
  std::vector<SkyObject> stars(const StopToken& stop) const {
    std::vector<SkyObject> found;
    if (!options_.stars) return found;
    const StarCatalogue& catalogue = *options_.stars;
    const Vec3 middle = observer_.moon_me_from_icrf().transpose_times(views_.reference().middle());
    const double radius = field_radius_rad(views_, margin_px_) + SkyObserver::kMaxParallaxAndDeflection_rad +
                          catalogue.largest_motion_rad(observer_.years_since_j2000()) + 1e-4;  // 1e-4: aberration
    for (const std::uint32_t index :
         catalogue.within(middle, std::min(radius, std::numbers::pi), options_.magnitude_limit)) {
      if (index % 1024 == 0) stop.check();
      const Star& star = catalogue.star(index);
      SkyObject object;
      set_direction(object, observer_.apparent(star));
      if (wants_positions_ && !near_image(object)) continue;
      object.id = catalogue.id(index);
      object.v_mag = static_cast<double>(star.v_mag);
      light_.set(object, [&](const Starlight& light, const Band*) {
        return light.of_star(object.v_mag, static_cast<double>(star.b_v));
      });
      found.push_back(std::move(object));
      if (wants_positions_ && found.size() > kMostStars)
        throw ImpossibleRequest(
            fmt::format("more than {} stars of {} are in view up to magnitude {:g}: lower the limit", kMostStars,
                        catalogue.name(), options_.magnitude_limit),
            "magnitude_limit");
    }
    std::stable_sort(found.begin(), found.end(),
                     [](const SkyObject& a, const SkyObject& b) { return a.v_mag < b.v_mag; });
    return found;
  }

  void add_bodies(std::vector<SkyObject>& sky) const {
    if (options_.sun) {
      SkyObject sun = object_of(SkyKind::sun, "sun", observer_.sun());
      sun.v_mag = sun_magnitude(*sun.distance_m);
      sun.phase_deg.reset();
      const double au = *sun.distance_m / kAstronomicalUnit_m;
      light_.set(sun, [au](const Starlight&, const Band* band) { return sunlight_w_m2(band) / (au * au); });
      sky.push_back(std::move(sun));
    }
    if (options_.earth) {
      const ApparentBody body = observer_.planet(Planet::earth);
      SkyObject earth = object_of(SkyKind::earth, "earth", body);
      earth.v_mag = planet_magnitude(Planet::earth, body);
      const double au = body.sun_distance_m / kAstronomicalUnit_m;
      light_.set(earth, [&](const Starlight&, const Band* band) {
        return earth_over_sun(body.distance_m, body.phase_deg, band) * sunlight_w_m2(band) / (au * au);
      });
      sky.push_back(std::move(earth));
    }
    for (const Planet planet : options_.planets ? other_planets() : std::span<const Planet>()) {
      const ApparentBody body = observer_.planet(planet);
      SkyObject object = object_of(SkyKind::planet, planet_name(planet), body);
      object.v_mag = planet_magnitude(planet, body);
      light_.set(object, [&](const Starlight& light, const Band*) { return light.of_planet(object.v_mag); });
      sky.push_back(std::move(object));
    }
  }

  SkyObject object_of(SkyKind kind, std::string_view id, const ApparentBody& body) const {
    SkyObject object;
    object.kind = kind;
    object.id = id;
    object.distance_m = body.distance_m;
    object.phase_deg = body.phase_deg;
    set_direction(object, body.direction);
    return object;
  }

  // Sets an object's direction, given in ICRF axes, and on request its position in the image.
  void set_direction(SkyObject& object, const Vec3& direction_icrf) const {
    object.direction_icrf = direction_icrf;
    object.direction = observer_.moon_me_from_icrf() * direction_icrf;
    if (!wants_positions_) return;
    const View& view = views_.reference();
    const Vec3 far_m = view.position() + kStarDistance_m * object.direction;
    if (views_.vary()) {
      if (const auto sighting = views_.find(far_m)) {
        object.x_px = sighting->pixel.x;
        object.y_px = sighting->pixel.y;
      }
    } else if (const auto pixel = view.project(far_m)) {
      object.x_px = pixel->x;
      object.y_px = pixel->y;
    }
    object.in_frame = near_image(object, 0);
  }

  bool near_image(const SkyObject& object) const { return near_image(object, margin_px_); }
  bool near_image(const SkyObject& object, double margin_px) const {
    return object.x_px >= -0.5 - margin_px && object.y_px >= -0.5 - margin_px &&
           object.x_px < request_.camera.width - 0.5 + margin_px &&
           object.y_px < request_.camera.height - 0.5 + margin_px;
  }

  const FrameRequest& request_;
  const SkyOptions& options_;
  const RowViews& views_;
  double margin_px_;
  bool wants_positions_;  // positions in the image
  SkyObserver observer_;
  SkyLight light_;
};

// Returns the index of the pixel of a row that is nearest to x.
std::size_t pixel_of(const Camera& camera, int row, double x_px) {
  const int column = std::clamp(static_cast<int>(std::lround(x_px)), 0, camera.width - 1);
  return static_cast<std::size_t>(row) * static_cast<std::size_t>(camera.width) + static_cast<std::size_t>(column);
}

}  // namespace

std::vector<SkyObject> sky_around(const FrameRequest& request, const RowViews& views, double margin_px,
                                  const StopToken& stop) {
  return SkyFinder(request, views, margin_px, true).find_all(stop);
}

std::vector<SkyObject> sky_around_rows(const FrameRequest& request, const RowViews& views, double margin_px,
                                       const StopToken& stop) {
  return SkyFinder(request, views, margin_px, false).find_all(stop);
}

EarthFigure earth_of(const FrameRequest& request, const RowViews& views) {
  const SkyOptions& sky = *request.sky;
  return EarthFigure(SkyObserver(sky.utc, views.reference().position(), sky.velocity_m_s, sky.states));
}

void find_hidden(const FrameRequest& request, const RowViews& views, std::span<const double> range_m,
                 const RenderContext& context, std::vector<SkyObject>& sky) {
  // Per object that has a position in the image: its ray, its index in `sky` and, if pixels decide, true if its pixel
  // shows a surface.
  std::vector<Ray> rays;
  std::vector<std::size_t> sky_index;
  std::vector<bool> behind_pixel;
  for (std::size_t i = 0; i < sky.size(); ++i) {
    if (std::isnan(sky[i].x_px)) continue;
    const int row = std::clamp(static_cast<int>(std::lround(sky[i].y_px)), 0, views.height() - 1);
    rays.push_back({views.of(row).position(), sky[i].direction});
    sky_index.push_back(i);
    if (!range_m.empty()) behind_pixel.push_back(!std::isnan(range_m[pixel_of(request.camera, row, sky[i].x_px)]));
  }
  const bool by_rays = request.terrain && range_m.empty();
  std::vector<HiddenBy> hidden = what_hides(rays, request.objects, by_rays, context);
  // Pixels without data count as sky. The Moon still occludes directions far below its limb, as it does for rays.
  for (std::size_t k = 0; k < behind_pixel.size(); ++k)
    if (hidden[k] == HiddenBy::none &&
        (behind_pixel[k] || std::isfinite(range_below_terrain_m({rays[k].origin_m, rays[k].direction}))))
      hidden[k] = HiddenBy::moon;
  // The Earth occludes behind the Moon and behind objects, which are near the camera. If the camera is beyond the Earth
  // or close to it, the Earth is in front of the Moon.
  const EarthFigure earth = earth_of(request, views);
  const bool nearer_than_moon = earth.body().distance_m < views.reference().position().norm();
  constexpr double kFar_m = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < sky_index.size(); ++k) {
    SkyObject& object = sky[sky_index[k]];
    object.hidden_by = hidden[k];
    const bool free = hidden[k] == HiddenBy::none || (hidden[k] == HiddenBy::moon && nearer_than_moon);
    if (free && object.kind != SkyKind::earth && earth.hides(object.direction, object.distance_m.value_or(kFar_m)))
      object.hidden_by = HiddenBy::earth;
  }
}

std::optional<double> pixel_sr(const RowViews& views, double x_px, double y_px) {
  constexpr double kStep_px = 0.01;
  const int row = std::clamp(static_cast<int>(std::lround(y_px)), 0, views.height() - 1);
  const Projection& projection = views.of(row).projection();
  const double y = views.line(row) + (y_px - row);
  const auto middle = projection.direction(x_px, y);
  const auto left = projection.direction(x_px - kStep_px, y), right = projection.direction(x_px + kStep_px, y);
  const auto above = projection.direction(x_px, y - kStep_px), below = projection.direction(x_px, y + kStep_px);
  if (!middle || !left || !right || !above || !below) return std::nullopt;
  // A surface element dA at a vector d has the solid angle dA . d / |d|^3. The differences span 2 x 2 steps.
  const double area_dot_d = (*right - *left).cross(*below - *above).dot(*middle) / (4 * kStep_px * kStep_px);
  return std::abs(area_dot_d) / std::pow(middle->norm(), 3);
}

std::vector<SkyObject> query_sky(const FrameRequest& request, const RenderContext& context) {
  const RowViews views(request.camera, request.pose, request.shutter, context.stop);
  if (request.terrain) refuse_underground(context.terrain, views, context.stop);
  refuse_enclosed(request.terrain ? &context.terrain : nullptr, request.objects, views, context.stop);
  std::vector<SkyObject> sky = sky_around(request, views, 0, context.stop);
  find_hidden(request, views, {}, context, sky);
  if (!request.sensor) return sky;
  const Sensor sensor(request, context.stop);
  for (SkyObject& object : sky) {
    if (!object.in_frame) continue;
    const auto sr = pixel_sr(views, object.x_px, object.y_px);
    const int row = std::clamp(static_cast<int>(std::lround(object.y_px)), 0, views.height() - 1);
    if (sr)
      object.electrons =
          sensor.point_e({object.x_px, object.y_px, views.of(row).moon_from_camera().transpose_times(object.direction),
                          object.counted_w_m2 / *sr});
  }
  return sky;
}

}  // namespace selenograph::engine
