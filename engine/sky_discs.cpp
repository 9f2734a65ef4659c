#include "engine/sky_discs.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "engine/frame/needs.h"
#include "engine/ray_queries.h"
#include "engine/sky/sky_observer.h"

namespace selenograph::engine {
namespace {

using std::numbers::pi;

// Radiance along a unit direction from the camera, MOON_ME; 0 beside the disc.
class Disc {
 public:
  virtual ~Disc() = default;
  virtual double radiance(const Vec3& direction) const = 0;
  virtual double radius_rad() const = 0;
};

// The integral of mu0 over the solid angle of a sphere of radius 1 that is seen from nearby: of a thin crescent, whose
// brightest part is at the limb, the horizon cuts off much. Longitudes from below the observer, away from the Sun.
double lit_sphere_sr(double phase_rad, double distance) {
  constexpr int kLatitudes = 128, kLongitudes = 256;
  const double first = phase_rad - pi / 2, step = (pi - phase_rad) / kLongitudes;
  double sum = 0;
  for (int j = 0; j < kLatitudes; ++j)
    for (int i = 0; i < kLongitudes; ++i) {
      const double lat = (j + 0.5) * pi / kLatitudes - pi / 2, lon = first + (i + 0.5) * step;
      const double up = std::cos(lat) * std::cos(lon) * distance - 1;  // over the horizon
      if (up <= 0) continue;
      const double way2 = distance * distance - 1 - 2 * up;
      sum += std::cos(lat) * std::cos(lat) * std::cos(lon - phase_rad) * up / (way2 * std::sqrt(way2));
    }
  return sum * step * pi / kLatitudes;
}

class SunDisc : public Disc {
 public:
  SunDisc(const SkyObject& sun, double limb_darkening)
      : centre_(sun.direction), darkening_(limb_darkening > 0 ? limb_darkening : 0.6) {
    sine_ = std::sin(sun_radius_deg(*sun.distance_m / kAstronomicalUnit_m) * kRadiansPerDegree);
    middle_ = sun.irradiance_w_m2 / (pi * sine_ * sine_ * (1 - darkening_ / 3));
  }
  double radiance(const Vec3& direction) const override {
    const double sine = direction.cross(centre_).norm() / sine_;
    if (sine >= 1 || direction.dot(centre_) < 0) return 0;
    return middle_ * (1 - darkening_ * (1 - std::sqrt(1 - sine * sine)));
  }
  double radius_rad() const override { return std::asin(sine_); }

 private:
  Vec3 centre_;
  double darkening_, sine_, middle_;
};

// In coordinates whose z axis is the Earth's, stretched along it so that the ellipsoid is a sphere of radius 1.
class EarthDisc : public Disc {
 public:
  EarthDisc(const SkyObject& earth, const ApparentBody& body, const Eigen::Matrix3d& moon_me_from_icrf)
      : icrf_from_moon_me_(moon_me_from_icrf.transpose()),
        toward_sun_(-body.from_sun),
        from_centre_(-body.distance_m / kEquator_m * stretched(icrf_from_moon_me_ * earth.direction)),
        radius_rad_(std::asin(kEquator_m / body.distance_m)) {
    const double lit_sr = lit_sphere_sr(body.phase_deg * kRadiansPerDegree, body.distance_m / kEquator_m) / kStretch;
    full_ = lit_sr > 0 ? earth.irradiance_w_m2 / lit_sr : 0;
  }
  double radiance(const Vec3& direction) const override {
    const Vec3 way = stretched(icrf_from_moon_me_ * direction);
    const double a = way.squaredNorm(), b = way.dot(from_centre_),
                 inside = b * b - a * (from_centre_.squaredNorm() - 1);
    if (inside <= 0 || b > 0) return 0;
    const Vec3 normal = stretched(from_centre_ + (-b - std::sqrt(inside)) / a * way).normalized();
    return full_ * std::max(0.0, normal.dot(toward_sun_));
  }
  double radius_rad() const override { return radius_rad_; }

 private:
  static constexpr double kEquator_m = 6378137, kStretch = 1 / (1 - 1 / 298.257223563);
  static Vec3 stretched(const Vec3& v) { return {v.x(), v.y(), v.z() * kStretch}; }

  Eigen::Matrix3d icrf_from_moon_me_;
  Vec3 toward_sun_, from_centre_;
  double radius_rad_, full_;
};

class DiscPainter {
 public:
  DiscPainter(const FrameRequest& request, const RowViews& views, std::span<const double> range_m,
              const StopToken& stop)
      : views_(views), range_m_(range_m), stop_(stop), width_(request.camera.width), height_(request.camera.height) {}

  void paint(const SkyObject& object, const Disc& disc, std::vector<float>& radiance) {
    const auto sr = pixel_sr(views_, object.x_px, object.y_px);
    if (!sr) return;
    // A lens may stretch it beside its centre.
    const double reach_px = 3 + 1.5 * disc.radius_rad() / std::sqrt(*sr);
    samples_ = reach_px < 9 ? 32 : 8;
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

  void paint_pixel(int x, int y, const Disc& disc, std::vector<float>& radiance) {
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
        const float value = share * static_cast<float>(disc.radiance(direction));
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
    painter.paint(object, EarthDisc(object, observer.planet(Planet::earth), observer.moon_me_from_icrf()), radiance);
  }
  painter.settle(what_hides(painter.rays(), request.objects, request.terrain, terrain, kept, stop), radiance);
}

}  // namespace selenograph::engine
