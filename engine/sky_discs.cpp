#include "engine/sky_discs.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "dem/support/error.h"
#include "dem/value_maps/value_map.h"
#include "engine/frame/needs.h"
#include "engine/ray_queries.h"
#include "engine/sky/sky_observer.h"

namespace selenograph::engine {
namespace {

using std::numbers::pi;

class Disc {
 public:
  virtual ~Disc() = default;
  // Radiance along a unit direction from the camera, MOON_ME, as a sample's mean over an angle of step_rad; 0 beside
  // the disc. For one thread.
  virtual double radiance(const Vec3& direction, double step_rad) = 0;
  virtual double radius_rad() const = 0;
};

// Visits the lit part of a sphere of radius 1 that is seen from nearby, as visit(mu0 times solid angle, place): of a
// thin crescent, whose brightest part is at the limb, the horizon cuts off much. Places along axes: toward the
// observer, and the second in the plane of the Sun.
template <typename Visit>
void over_lit_sphere(double phase_rad, double distance, const Visit& visit) {
  constexpr int kLatitudes = 128, kLongitudes = 256;
  const double first = phase_rad - pi / 2, step = (pi - phase_rad) / kLongitudes;
  for (int j = 0; j < kLatitudes; ++j)
    for (int i = 0; i < kLongitudes; ++i) {
      const double lat = (j + 0.5) * pi / kLatitudes - pi / 2, lon = first + (i + 0.5) * step;
      const double up = std::cos(lat) * std::cos(lon) * distance - 1;  // over the horizon
      if (up <= 0) continue;
      const double way2 = distance * distance - 1 - 2 * up;
      visit(std::cos(lat) * std::cos(lat) * std::cos(lon - phase_rad) * up / (way2 * std::sqrt(way2)) * step * pi /
                kLatitudes,
            Vec3(std::cos(lat) * std::cos(lon), std::cos(lat) * std::sin(lon), std::sin(lat)));
    }
}

class SunDisc : public Disc {
 public:
  SunDisc(const SkyObject& sun, std::optional<double> limb_darkening)
      : centre_(sun.direction), darkening_(limb_darkening.value_or(0.6)) {
    sine_ = std::sin(sun_radius_deg(*sun.distance_m / kAstronomicalUnit_m) * kRadiansPerDegree);
    middle_ = sun.irradiance_w_m2 / (pi * sine_ * sine_ * (1 - darkening_ / 3));
  }
  double radiance(const Vec3& direction, double) override {
    const double sine = direction.cross(centre_).norm() / sine_;
    if (sine >= 1 || direction.dot(centre_) < 0) return 0;
    return middle_ * (1 - darkening_ * (1 - std::sqrt(1 - sine * sine)));
  }
  double radius_rad() const override { return std::asin(sine_); }

 private:
  Vec3 centre_;
  double darkening_, sine_, middle_;
};

// How bright places on the Earth are relative to the mean of all that is lit and seen, each by its light.
class EarthPattern {
 public:
  EarthPattern(const EarthMap& map, const StopToken& stop) {
    if (map.content) map_.emplace(*map.content, stop);
  }
  // `observer`, `sun`: unit, in the Earth's axes; `distance`: in its radii.
  void set_mean(const Vec3& observer, const Vec3& sun, double phase_rad, double distance) {
    if (!map_) return;
    Eigen::Matrix3d axes;
    axes.col(0) = observer;
    axes.col(1) = (sun - sun.dot(observer) * observer).normalized();
    axes.col(2) = axes.col(0).cross(axes.col(1));
    constexpr double kApart_rad = pi / 128;
    double all = 0, sum = 0;
    over_lit_sphere(phase_rad, distance, [&](double light, const Vec3& place) {
      const Vec3 normal = axes * place;
      const EastNorthUp local = local_axes(normal);
      const double value = at(normal, kApart_rad * local.east, kApart_rad * local.north);
      if (!std::isnan(value)) all += light, sum += light * value;
    });
    if (all > 0 && !(sum > 0)) throw ImpossibleRequest("the map is 0 wherever the Earth is lit and seen", "earth_map");
    if (all > 0) mean_ = sum / all;
  }
  // At a geodetic normal, over a parallelogram with these sides in radii; 1 where the map has no value.
  double relative(const Vec3& normal, const Vec3& a, const Vec3& b) {
    if (!map_ || std::isnan(mean_)) return 1;
    const double value = at(normal, a, b);
    return std::isnan(value) ? 1 : value / mean_;
  }

 private:
  double at(const Vec3& normal, const Vec3& a, const Vec3& b) {
    const EastNorthUp local = local_axes(normal);
    // Maps measure on the Moon's sphere.
    const auto side = [&](const Vec3& v) {
      return std::array{kMoonRadius_m * local.east.dot(v), kMoonRadius_m * local.north.dot(v)};
    };
    const double lat_deg = std::asin(std::clamp(normal.z(), -1.0, 1.0)) * kDegreesPerRadian,
                 lon_deg = std::atan2(normal.y(), normal.x()) * kDegreesPerRadian;
    return std::max(map_->mean({lat_deg, lon_deg, side(a), side(b)}).value, 0.0);
  }
  std::optional<dem::ValueMap::Sampler> map_;
  double mean_ = std::numeric_limits<double>::quiet_NaN();
};

// In the Earth's axes, stretched along the z axis so that the ellipsoid is a sphere of radius 1.
class EarthDisc : public Disc {
 public:
  EarthDisc(const SkyObject& earth, const ApparentBody& body, const SkyObserver& observer, const EarthMap& map,
            const StopToken& stop)
      : earth_from_moon_me_(observer.earth_from_icrf(body.distance_m) * observer.moon_me_from_icrf().transpose()),
        toward_sun_(observer.earth_from_icrf(body.distance_m) * -body.from_sun),
        from_centre_(-body.distance_m / kEquator_m * stretched(earth_from_moon_me_ * earth.direction)),
        radius_rad_(std::asin(kEquator_m / body.distance_m)),
        pattern_(map, stop) {
    const double phase_rad = body.phase_deg * kRadiansPerDegree, distance = body.distance_m / kEquator_m;
    double lit_sr = 0;
    over_lit_sphere(phase_rad, distance, [&](double light, const Vec3&) { lit_sr += light / kStretch; });
    full_ = lit_sr > 0 ? earth.irradiance_w_m2 / lit_sr : 0;
    pattern_.set_mean(-(earth_from_moon_me_ * earth.direction), toward_sun_, phase_rad, distance);
  }
  double radiance(const Vec3& direction, double step_rad) override {
    const Vec3 seen = earth_from_moon_me_ * direction, way = stretched(seen);
    const double a = way.squaredNorm(), b = way.dot(from_centre_),
                 inside = b * b - a * (from_centre_.squaredNorm() - 1);
    if (inside <= 0 || b > 0) return 0;
    const double range = (-b - std::sqrt(inside)) / a;
    const Vec3 normal = stretched(from_centre_ + range * way).normalized();
    const double mu0 = normal.dot(toward_sun_);
    if (mu0 <= 0) return 0;
    // What a step across the line of sight is on the ground: longer by 1 / mu along the way.
    const double mu = std::max(-normal.dot(seen), 0.05);
    const Vec3 across =
        normal.cross(seen).norm() > 1e-9 ? Vec3(normal.cross(seen).normalized()) : normal.unitOrthogonal();
    const Vec3 along = normal.cross(across);
    return full_ * mu0 * pattern_.relative(normal, step_rad * range * across, step_rad * range / mu * along);
  }
  double radius_rad() const override { return radius_rad_; }

 private:
  static constexpr double kEquator_m = 6378137, kStretch = 1 / (1 - 1 / 298.257223563);
  static Vec3 stretched(const Vec3& v) { return {v.x(), v.y(), v.z() * kStretch}; }

  Eigen::Matrix3d earth_from_moon_me_;
  Vec3 toward_sun_, from_centre_;
  double radius_rad_, full_;
  EarthPattern pattern_;
};

class DiscPainter {
 public:
  DiscPainter(const FrameRequest& request, const RowViews& views, std::span<const double> range_m,
              const StopToken& stop)
      : views_(views), range_m_(range_m), stop_(stop), width_(request.camera.width), height_(request.camera.height) {}

  void paint(const SkyObject& object, Disc&& disc, std::vector<float>& radiance) {
    const auto sr = pixel_sr(views_, object.x_px, object.y_px);
    if (!sr) return;
    // A lens may stretch it beside its centre.
    const double reach_px = 3 + 1.5 * disc.radius_rad() / std::sqrt(*sr);
    samples_ = reach_px < 9 ? 32 : 8;
    step_rad_ = std::sqrt(*sr) / samples_;
    const auto clipped = [](double at, int size) { return static_cast<int>(std::clamp(at, 0.0, size - 1.0)); };
    for (int y = clipped(object.y_px - reach_px, height_); y <= clipped(object.y_px + reach_px, height_); ++y) {
      stop_.check();
      for (int x = clipped(object.x_px - reach_px, width_); x <= clipped(object.x_px + reach_px, width_); ++x)
        paint_pixel(x, y, disc, radiance);
    }
  }

  // Samples of pixels at a border, which settle() adds if nothing hides them.
  const std::vector<Ray>& rays() const { return rays_; }
  void settle(const std::vector<HiddenBy>& hidden, std::vector<float>& radiance) const {
    for (std::size_t i = 0; i < hidden.size(); ++i)
      if (hidden[i] == HiddenBy::none) radiance[pixel_[i]] += value_[i];
  }

 private:
  enum class Sight { free, hidden, border };
  Sight sight(int x, int y) const {
    bool sky = false, surface = false;
    for (int j = std::max(0, y - 1); j <= std::min(height_ - 1, y + 1); ++j)
      for (int i = std::max(0, x - 1); i <= std::min(width_ - 1, x + 1); ++i)
        (std::isnan(range_m_[at(i, j)]) ? sky : surface) = true;
    return !surface ? Sight::free : sky ? Sight::border : Sight::hidden;
  }

  void paint_pixel(int x, int y, Disc& disc, std::vector<float>& radiance) {
    const Sight sight_here = sight(x, y);
    if (sight_here == Sight::hidden) return;
    const View& view = views_.of(y);
    const float share = 1.F / static_cast<float>(samples_ * samples_);
    for (int j = 0; j < samples_; ++j)
      for (int i = 0; i < samples_; ++i) {
        const double across = (i + 0.5) / samples_ - 0.5, down = (j + 0.5) / samples_ - 0.5;
        const auto ray = view.ray(x + across, views_.line(y) + down);
        if (!ray) continue;
        const Vec3 direction = ray->normalized();
        const float value = share * static_cast<float>(disc.radiance(direction, step_rad_));
        if (value == 0) continue;
        if (sight_here == Sight::free)
          radiance[at(x, y)] += value;
        else
          rays_.push_back({view.position(), direction}), pixel_.push_back(at(x, y)), value_.push_back(value);
      }
  }

  std::size_t at(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
  }

  const RowViews& views_;
  std::span<const double> range_m_;
  const StopToken& stop_;
  int width_, height_, samples_ = 8;
  double step_rad_ = 0;    // from sample to sample
  std::vector<Ray> rays_;  // of samples whose pixels are at a border
  std::vector<std::size_t> pixel_;
  std::vector<float> value_;
};

}  // namespace

void add_discs(const FrameRequest& request, std::span<const double> range_m, const dem::Terrain& terrain,
               RenderCache& kept, const StopToken& stop, std::vector<float>& radiance) {
  if (!wants_discs(request)) return;
  const RowViews views(request.camera, request.pose, request.shutter, stop);
  DiscPainter painter(request, views, range_m, stop);
  FrameRequest discs_alone = request;
  discs_alone.sky->stars.reset(), discs_alone.sky->planets = false;
  for (const SkyObject& object : sky_around(discs_alone, views, 0, stop)) {
    if (std::isnan(object.x_px)) continue;
    if (object.kind == SkyKind::sun) painter.paint(object, SunDisc(object, request.sun.limb_darkening), radiance);
    if (object.kind != SkyKind::earth) continue;
    const SkyObserver observer(request.sky->utc, views.reference().position(), request.sky->velocity_m_s);
    painter.paint(object, EarthDisc(object, observer.planet(Planet::earth), observer, request.sky->earth_map, stop),
                  radiance);
  }
  painter.settle(what_hides(painter.rays(), request.objects, request.terrain, terrain, kept, stop), radiance);
}

}  // namespace selenograph::engine
