#include "engine/sky/sky_discs.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

#include "dem/base/error.h"
#include "dem/value_maps/value_map.h"
#include "engine/cache/render_context.h"
#include "engine/frame/needs.h"
#include "engine/rays/ray_queries.h"
#include "engine/scene/ray_selection.h"
#include "engine/sky/earth_figure.h"

namespace selenograph::engine {
namespace {

using std::numbers::pi;

// Integration of a disc over a pixel:
//
//   pixel part --> cells, 8 across the disc --> lines across the rim --> intervals between edges --> 8 Gauss points
//
//   +-----------+
//   |---(====)--|   A line of a cell is cut at the edges of the lit surface:
//   |--(=====)--|   the limb, the terminator, the limb of the Earth before
//   +-----------+   the Sun. Only the intervals marked = shine.
//
// Each interval is integrated by itself, because at its ends the radiance may have a step or rise like a square root.
class Disc {
 public:
  virtual ~Disc() = default;
  // Adds the parameters t in (0, 1) at which the lines of sight from + t step (MOON_ME, of any length) cross an edge of
  // the lit surface.
  virtual void add_edges(const Vec3& from, const Vec3& step, std::vector<double>& t) const = 0;
  // Returns true if a unit direction from the camera, MOON_ME, hits the lit surface.
  virtual bool shines(const Vec3& direction) const = 0;
  // Returns the radiance, W m-2 sr-1, along such a direction, averaged over an angle of step_rad; 0 off the lit
  // surface. Not thread-safe.
  virtual double radiance(const Vec3& direction, double step_rad) = 0;
  virtual const Vec3& centre() const = 0;  // unit, MOON_ME
  virtual double radius_rad() const = 0;
  virtual double narrowest_rad() const = 0;  // smallest width of the lit surface: that of a crescent
};

// Adds the roots t in (0, 1) of form(ray, ray), where ray = from + t step. The form is bilinear and symmetric, so this
// is the quadratic equation square t^2 + 2 half_linear t + constant = 0.
template <typename Form>
void add_roots(const Form& form, const Vec3& from, const Vec3& step, std::vector<double>& t) {
  const double constant = form(from, from), half_linear = form(from, step), square = form(step, step);
  const double discriminant = half_linear * half_linear - constant * square;
  if (!(discriminant > 0)) return;
  // Adding terms of one sign loses no digits; the other root follows from the product of both, constant / square.
  const double q = -(half_linear + std::copysign(std::sqrt(discriminant), half_linear));
  for (const double root : {q / square, constant / q})
    if (root > 0 && root < 1) t.push_back(root);
}

// Adds the parameters at which a line of sight crosses the Earth's limb, which bounds the Earth and may cover the Sun.
void add_limb_edges(const EarthFigure& earth, const Vec3& from, const Vec3& step, std::vector<double>& t) {
  const auto stretched = [&](const Vec3& v) { return EarthFigure::stretched(earth.earth_from_moon_me() * v); };
  add_roots([&](const Vec3& a, const Vec3& b) { return earth.limb_form(a, b); }, stretched(from), stretched(step), t);
}

// The Sun's disc, except for the part that the Earth occludes.
class SunDisc : public Disc {
 public:
  SunDisc(const SkyObject& sun, std::optional<double> limb_darkening, const EarthFigure& earth)
      : earth_(earth),
        centre_(sun.direction),
        distance_m_(*sun.distance_m),
        darkening_(limb_darkening.value_or(0.6)),
        sine_(std::sin(sun_radius_deg(distance_m_ / kAstronomicalUnit_m) * kRadiansPerDegree)),
        // The mean of 1 - u (1 - mu) over the disc is 1 - u / 3.
        centre_radiance_(sun.irradiance_w_m2 / (pi * sine_ * sine_ * (1 - darkening_ / 3))) {}
  void add_edges(const Vec3& from, const Vec3& step, std::vector<double>& t) const override {
    // The form is 0 for a ray at the Sun's angular radius from its centre: (ray . centre)^2 = cos^2(radius) ray^2.
    const auto limb_form = [this](const Vec3& a, const Vec3& b) {
      return a.dot(centre_) * b.dot(centre_) - (1 - sine_ * sine_) * a.dot(b);
    };
    add_roots(limb_form, from, step, t);
    add_limb_edges(earth_, from, step, t);
  }
  bool shines(const Vec3& direction) const override {
    return radii_off_centre(direction) < 1 && direction.dot(centre_) > 0 && !earth_.hides(direction, distance_m_);
  }
  // Limb darkening varies slowly over the disc: a sample need not be averaged over its angle.
  double radiance(const Vec3& direction, double) override {
    if (!shines(direction)) return 0;
    // At r radii off the centre, the cosine of emission is sqrt(1 - r^2).
    const double radii = radii_off_centre(direction);
    return centre_radiance_ * (1 - darkening_ * (1 - std::sqrt(1 - radii * radii)));
  }
  const Vec3& centre() const override { return centre_; }
  double radius_rad() const override { return std::asin(sine_); }
  double narrowest_rad() const override {
    const double uncovered_rad = angle_between(centre_, earth_.direction()) + radius_rad() - earth_.radius_rad();
    return std::clamp(uncovered_rad, 0.0, 2 * radius_rad());
  }

 private:
  // Returns the distance from the disc's centre in radii of the disc.
  double radii_off_centre(const Vec3& direction) const { return direction.cross(centre_).norm() / sine_; }

  const EarthFigure& earth_;
  Vec3 centre_;
  double distance_m_;
  double darkening_;        // coefficient u of the limb darkening
  double sine_;             // of the Sun's angular radius
  double centre_radiance_;  // of the disc's centre, W m-2 sr-1
};

// Brightness of the Earth's surface relative to its mean over the visible lit surface, weighted by light. Without a map
// it is 1. Call add_to_mean() for all of that surface, then finish_mean(), then relative().
class EarthPattern {
 public:
  EarthPattern(const EarthMap& map, const StopToken& stop) {
    if (map.content) map_.emplace(*map.content, stop);
  }
  // Adds a surface element, given by its geodetic normal, to the mean.
  void add_to_mean(double light, const Vec3& normal) {
    if (!map_) return;
    constexpr double kSide_rad = pi / 128;  // of the square over which the map is averaged: visit_lit()'s spacing
    const EastNorthUp local = local_axes(normal);
    const double value = map_value(normal, kSide_rad * local.east, kSide_rad * local.north);
    if (!std::isnan(value)) {
      light_sum_ += light;
      value_sum_ += light * value;
    }
  }
  // Throws ImpossibleRequest if the mean is 0.
  void finish_mean() {
    if (light_sum_ > 0 && !(value_sum_ > 0))
      throw ImpossibleRequest("the map is 0 wherever the Earth is lit and seen", "earth_map");
    if (light_sum_ > 0) mean_ = value_sum_ / light_sum_;
  }
  // Returns the relative brightness at a geodetic normal, averaged over a parallelogram with sides `a` and `b` in Earth
  // radii; 1 where the map has no value.
  double relative(const Vec3& normal, const Vec3& a, const Vec3& b) {
    if (!map_ || std::isnan(mean_)) return 1;
    const double value = map_value(normal, a, b);
    return std::isnan(value) ? 1 : value / mean_;
  }

 private:
  // Returns the map's mean over a parallelogram, at least 0; NaN where the map has no value.
  double map_value(const Vec3& normal, const Vec3& a, const Vec3& b) {
    const EastNorthUp local = local_axes(normal);
    // Value maps measure sides in metres on the Moon's sphere: scale angles by its radius.
    const auto side = [&](const Vec3& v) {
      return std::array{kMoonRadius_m * local.east.dot(v), kMoonRadius_m * local.north.dot(v)};
    };
    const double lat_deg = std::asin(std::clamp(normal.z(), -1.0, 1.0)) * kDegreesPerRadian,
                 lon_deg = std::atan2(normal.y(), normal.x()) * kDegreesPerRadian;
    return std::max(map_->mean({lat_deg, lon_deg, side(a), side(b)}).value, 0.0);
  }
  std::optional<dem::ValueMap::Sampler> map_;
  double light_sum_ = 0, value_sum_ = 0, mean_ = std::numeric_limits<double>::quiet_NaN();
};

// The lit part of the Earth's disc. Computes in the axes of EarthFigure, in Earth radii; "stretched" axes are those in
// which the ellipsoid is the unit sphere.
class EarthDisc : public Disc {
 public:
  EarthDisc(const SkyObject& earth, const EarthFigure& figure, const SkyObserver& observer, const EarthMap& map,
            const StopToken& stop)
      : figure_(figure),
        toward_sun_(observer.earth_from_icrf(figure.body().distance_m) * -figure.body().from_sun),
        terminator_normal_(EarthFigure::stretched(toward_sun_)),
        narrowest_rad_(figure.radius_rad() * (1 + std::cos(figure.body().phase_deg * kRadiansPerDegree))),
        pattern_(map, stop) {
    double lit_sr = 0;
    visit_lit([&](double light, const Vec3& normal) {
      lit_sr += light;
      pattern_.add_to_mean(light, normal);
    });
    subsolar_radiance_ = lit_sr > 0 ? earth.irradiance_w_m2 / lit_sr : 0;
    pattern_.finish_mean();
  }
  // The limb is where a ray touches the sphere. The terminator is where it hits the sphere and the terminator's plane,
  // which contains the centre, in the same point. From the viewpoint f, a ray r hits the plane with the normal s in
  // f - (f.s / r.s) r; that point is on the unit sphere if, multiplied by (r.s)^2,
  // (f.f - 1) (r.s)^2 - 2 (f.s) (r.s) (r.f) + (f.s)^2 r.r = 0.
  void add_edges(const Vec3& from, const Vec3& step, std::vector<double>& t) const override {
    const Vec3 &f = figure_.from_centre(), &s = terminator_normal_;
    const double f_f = f.squared_norm(), f_s = f.dot(s);
    const auto terminator_form = [&](const Vec3& a, const Vec3& b) {
      return (f_f - 1) * a.dot(s) * b.dot(s) - f_s * (a.dot(s) * b.dot(f) + b.dot(s) * a.dot(f)) + f_s * f_s * a.dot(b);
    };
    add_limb_edges(figure_, from, step, t);
    add_roots(terminator_form, stretched(from), stretched(step), t);
  }
  bool shines(const Vec3& direction) const override { return hit(in_earth_axes(direction)).mu0 > 0; }
  double radiance(const Vec3& direction, double step_rad) override {
    const Vec3 ray = in_earth_axes(direction);
    const Hit surface = hit(ray);
    if (surface.mu0 <= 0) return 0;
    // Project the sample's footprint to the ground: it is longer by 1 / mu in the plane of the ray and the normal.
    const Vec3& normal = surface.normal;
    const double mu = std::max(-normal.dot(ray), 0.05);  // bounded, so that the footprint stays finite at the limb
    const Vec3 across =
        normal.cross(ray).norm() > 1e-9 ? Vec3(normal.cross(ray).normalized()) : normal.unit_orthogonal();
    const Vec3 along = normal.cross(across);
    const double side = step_rad * surface.range;
    return subsolar_radiance_ * surface.mu0 * pattern_.relative(normal, side * across, side / mu * along);
  }
  const Vec3& centre() const override { return figure_.direction(); }
  double radius_rad() const override { return figure_.radius_rad(); }
  double narrowest_rad() const override { return narrowest_rad_; }

 private:
  Vec3 in_earth_axes(const Vec3& direction) const { return figure_.earth_from_moon_me() * direction; }
  Vec3 stretched(const Vec3& direction) const { return EarthFigure::stretched(in_earth_axes(direction)); }

  struct Hit {
    Vec3 normal = Vec3::zero();  // geodetic
    double range = 0, mu0 = 0;   // in Earth radii; cosine of incidence
  };
  // Intersects a unit direction in the Earth's axes. A miss has mu0 = 0.
  Hit hit(const Vec3& ray) const {
    const Vec3 stretched_ray = EarthFigure::stretched(ray);
    const std::optional<double> range = figure_.range(stretched_ray);
    if (!range) return {};
    const Vec3 normal = EarthFigure::stretched(figure_.from_centre() + *range * stretched_ray).normalized();
    return {normal, *range, normal.dot(toward_sun_)};
  }

  // Visits the visible lit surface on a grid, as visit(cosine of incidence times solid angle, geodetic normal).
  // Longitudes of the grid run from the terminator to the horizon, so that a thin crescent, whose brightest part is at
  // the limb, has as many points as a full disc. Axes: the first toward the observer, the second in the Sun's plane.
  template <typename Visit>
  void visit_lit(const Visit& visit) const {
    constexpr int kLatitudes = 128, kLongitudes = 256;
    constexpr double kStretch = EarthFigure::kStretch;
    const Vec3& from_centre = figure_.from_centre();
    const double distance = from_centre.norm();
    // The grid's pole is normal to the plane of observer, Earth and Sun.
    const Vec3 pole = from_centre.cross(terminator_normal_);
    Mat3 axes;
    axes.col(0) = from_centre / distance;
    axes.col(2) = pole.norm() > 1e-9 * distance ? Vec3(pole.normalized()) : Vec3(axes.col(0).unit_orthogonal());
    axes.col(1) = axes.col(2).cross(axes.col(0));
    // The horizon is acos(1 / distance) from the point below the observer; the terminator 90 degrees from the Sun's.
    const double terminator_lon = std::atan2(pole.norm(), from_centre.dot(terminator_normal_)) - pi / 2,
                 lon_step = (std::acos(1 / distance) - terminator_lon) / kLongitudes;
    if (lon_step <= 0) return;
    for (int j = 0; j < kLatitudes; ++j)
      for (int i = 0; i < kLongitudes; ++i) {
        const double lat = (j + 0.5) * pi / kLatitudes - pi / 2, lon = terminator_lon + (i + 0.5) * lon_step;
        const Vec3 point = axes * Vec3(std::cos(lat) * std::cos(lon), std::cos(lat) * std::sin(lon), std::sin(lat));
        const double up = point.dot(from_centre) - 1;  // positive above the observer's horizon
        if (up <= 0) continue;
        // A patch of the unit sphere has the solid angle area * up / range^3. Undoing the stretch divides the volume of
        // its cone, and so the solid angle at the same range, by kStretch.
        const Vec3 line = point - from_centre, normal = EarthFigure::stretched(point).normalized();
        const double range = Vec3(line.x(), line.y(), line.z() / kStretch).norm(),
                     sr = std::cos(lat) * lon_step * pi / kLatitudes * up / (range * range * range * kStretch);
        visit(normal.dot(toward_sun_) * sr, normal);
      }
  }

  const EarthFigure& figure_;
  Vec3 toward_sun_;
  Vec3 terminator_normal_;  // of the plane of the sphere's terminator, stretched axes, on its lit side
  double narrowest_rad_, subsolar_radiance_;
  EarthPattern pattern_;
};

// A rectangle of the image, in pixels. The default is the whole plane.
struct PixelBox {
  double left = -std::numeric_limits<double>::infinity(), right = -left, top = left, bottom = right;
};

// Adds discs to a frame's radiance. Pixels in the middle of the sky are finished at once; those at a border of the Moon
// or an object leave rays, which the caller traces.
class DiscPainter {
 public:
  DiscPainter(const FrameRequest& request, const RowViews& views, std::span<const double> range_m,
              const StopToken& stop)
      : views_(views),
        range_m_(range_m),
        stop_(stop),
        width_(request.camera.width),
        height_(request.camera.height),
        neighbours_(hides_by_pixels(request) ? 0 : 1),
        moon_(request.terrain) {}

  // Adds a disc to the radiance, except for pixels at a border: their samples become rays().
  void paint(Disc&& disc, std::vector<float>& radiance) {
    std::optional<PixelBox> box;
    for (int y = 0; y < height_; ++y) {
      stop_.check();
      if (y == 0 || views_.vary()) box = box_around(disc, views_.of(y));
      const int line = views_.line(y);  // row of the view's own image: 0 for a line camera
      if (!box || box->bottom < line - 0.5 || box->top > line + 0.5) continue;
      const int first = static_cast<int>(std::clamp(std::floor(box->left + 0.5), 0.0, width_ - 0.0)),
                last = static_cast<int>(std::clamp(std::floor(box->right + 0.5), -1.0, width_ - 1.0));
      for (int x = first; x <= last; ++x) paint_pixel(x, y, *box, disc, radiance);
    }
  }

  // Returns the samples of pixels at a border. Trace them, then pass their occluders to add_visible().
  const std::vector<Ray>& rays() const { return rays_; }
  void add_visible(const std::vector<HiddenBy>& hidden, std::vector<float>& radiance) const {
    for (std::size_t i = 0; i < hidden.size(); ++i)
      if (hidden[i] == HiddenBy::none) radiance[pixel_[i]] += value_[i];
  }

 private:
  // Returns a box around the image of the disc's rim, with a margin for the arcs between the rim's points. The margin
  // is wider if the lens images only some of the points; if it images none, the box is everything. Empty if the disc is
  // outside the view.
  static std::optional<PixelBox> box_around(const Disc& disc, const View& view) {
    constexpr double kFar_m = 1e15;
    const Vec3 &centre = disc.centre(), ahead = view.moon_from_camera().col(2);
    const double radius = disc.radius_rad();
    if (!view.may_see(view.position() + kFar_m * centre, kFar_m * std::sin(radius))) return std::nullopt;
    const PixelBox unbounded;
    // Close to a fisheye's rear axis the image of the rim encloses everything but the disc.
    if (ahead.dot(centre) < -std::cos(2 * radius)) return unbounded;
    // Start the rim at the point farthest from the boresight, where lenses stretch most.
    const Vec3 aside = ahead.cross(centre), y = aside.norm() > 1e-9 ? aside.normalized() : centre.unit_orthogonal(),
               x = y.cross(centre);
    PixelBox box{unbounded.right, unbounded.left, unbounded.bottom, unbounded.top};  // empty: each point extends it
    // Extends the box by points of the rim; returns true if the lens images all of them.
    const auto extend_by_rim = [&](int points) {
      int imaged = 0;
      for (int i = 0; i < points; ++i) {
        const double turn = 2 * pi * i / points;
        const Vec3 rim = std::cos(radius) * centre + std::sin(radius) * (std::cos(turn) * x + std::sin(turn) * y);
        const auto pixel = view.projection().image(view.moon_from_camera().transpose_times(rim));
        if (!pixel) continue;
        ++imaged;
        box.left = std::min(box.left, pixel->x);
        box.right = std::max(box.right, pixel->x);
        box.top = std::min(box.top, pixel->y);
        box.bottom = std::max(box.bottom, pixel->y);
      }
      return imaged == points;
    };
    // A rim that is imaged in part gets more points, to find even a short part.
    const bool is_complete = extend_by_rim(64) || extend_by_rim(1024);
    if (box.left > box.right) return unbounded;
    const double margin_share = is_complete ? 0.05 : 0.5, min_margin_px = is_complete ? 0 : 2;
    const double margin_x = margin_share * (box.right - box.left) + min_margin_px,
                 margin_y = margin_share * (box.bottom - box.top) + min_margin_px;
    return PixelBox{box.left - margin_x, box.right + margin_x, box.top - margin_y, box.bottom + margin_y};
  }

  // Classifies a pixel by its own range (NaN: sky) and, unless pixels decide, by those of its neighbours.
  enum class Sight { free, hidden, border };
  Sight sight(int x, int y) const {
    bool sky = false, surface = false;
    for (int j = std::max(0, y - neighbours_); j <= std::min(height_ - 1, y + neighbours_); ++j)
      for (int i = std::max(0, x - neighbours_); i <= std::min(width_ - 1, x + neighbours_); ++i)
        (std::isnan(range_m_[pixel_index(i, j)]) ? sky : surface) = true;
    return !surface ? Sight::free : sky ? Sight::border : Sight::hidden;
  }

  // A pixel while it is painted.
  struct Pixel {
    const View& view;
    std::size_t index;
    bool at_border;
    double step_rad = 0;  // approximate angle between samples
    double radiance = 0;  // sum of its samples that are visible without tracing, W m-2 sr-1
  };

  // Paints the part of a pixel inside the disc's box, in cells that are small compared with the disc.
  void paint_pixel(int x, int y, const PixelBox& box, Disc& disc, std::vector<float>& radiance) {
    const Sight sight_here = sight(x, y);
    if (sight_here == Sight::hidden) return;
    const double line = views_.line(y);
    const double left = std::max(x - 0.5, box.left), right = std::min(x + 0.5, box.right);
    const double top = std::max(line - 0.5, box.top), bottom = std::min(line + 0.5, box.bottom);
    if (left >= right || top >= bottom) return;
    // Eight cells span the disc.
    const auto cells = [](double length, double disc_length) {
      return std::max(1, static_cast<int>(std::ceil(8 * length / disc_length)));
    };
    const int columns = cells(right - left, box.right - box.left), rows = cells(bottom - top, box.bottom - box.top);
    const auto at_x = [&](double column) { return std::lerp(left, right, column / columns); };
    const auto at_y = [&](double row) { return std::lerp(top, bottom, row / rows); };
    Pixel pixel{views_.of(y), pixel_index(x, y), sight_here == Sight::border};
    for (int j = 0; j < rows; ++j)
      for (int i = 0; i < columns; ++i) paint_cell({at_x(i), at_x(i + 1), at_y(j), at_y(j + 1)}, disc, pixel);
    radiance[pixel.index] += static_cast<float>(pixel.radiance);
  }

  // Paints a cell by lines across the rim: a crescent is thin in that direction, and lines find its edges exactly. A
  // crescent thinner than a cell gets more lines.
  void paint_cell(const PixelBox& cell, Disc& disc, Pixel& pixel) {
    constexpr double kStep_px = 0.01;
    const double x = (cell.left + cell.right) / 2, y = (cell.top + cell.bottom) / 2, width = cell.right - cell.left,
                 height = cell.bottom - cell.top;
    const auto centre_ray = pixel.view.ray(x, y), right = pixel.view.ray(x + kStep_px, y),
               below = pixel.view.ray(x, y + kStep_px);
    if (!centre_ray || !right || !below) return;
    const double length = centre_ray->norm();
    // Sides of the cell as angles on the sky: `across` along its rows, `down` along its columns.
    const Vec3 ray = *centre_ray / length, across = width / (kStep_px * length) * (*right - *centre_ray),
               down = height / (kStep_px * length) * (*below - *centre_ray);
    if (angle_between(ray, disc.centre()) > disc.radius_rad() + across.norm() + down.norm()) return;
    const double side_rad = std::sqrt(std::abs(across.cross(down).dot(ray)));
    const int lines = disc.narrowest_rad() < side_rad ? 32 : 8;
    pixel.step_rad = side_rad / static_cast<double>(kQuadrature.size());
    // Direction from the disc's centre to the cell: lines run along the image axis that is closer to it.
    const Vec3 outward = ray.dot(disc.centre()) * ray - disc.centre();
    const bool along_rows = std::abs(outward.dot(across)) / width >= std::abs(outward.dot(down)) / height;
    for (int i = 0; i < lines; ++i) {
      const double offset = (i + 0.5) / lines, share_of_pixel = width * height / lines;
      const double line_x = std::lerp(cell.left, cell.right, offset), line_y = std::lerp(cell.top, cell.bottom, offset);
      if (along_rows)
        paint_line({cell.left, line_y}, {cell.right, line_y}, share_of_pixel, disc, pixel);
      else
        paint_line({line_x, cell.top}, {line_x, cell.bottom}, share_of_pixel, disc, pixel);
    }
  }

  // Paints a line that stands for a share of the pixel, by Gauss-Legendre quadrature between the edges of the lit
  // surface. Halve the line if its rays are not evenly spaced from end to end, or if the lens does not image an end.
  void paint_line(const PixelXY& a, const PixelXY& b, double share, Disc& disc, Pixel& pixel) {
    constexpr double kEven_rad = 0.01, kShortest_px = 0.01;
    const auto first = pixel.view.ray(a.x, a.y), last = pixel.view.ray(b.x, b.y);
    const bool even = first && last && angle_between(*first, *last) < kEven_rad;
    if (!even && std::abs(b.x - a.x) + std::abs(b.y - a.y) > kShortest_px) {
      const PixelXY middle{(a.x + b.x) / 2, (a.y + b.y) / 2};
      paint_line(a, middle, share / 2, disc, pixel);
      paint_line(middle, b, share / 2, disc, pixel);
      return;
    }
    if (!first || !last) return;
    const Vec3 step = *last - *first;
    edges_.assign({0, 1});
    disc.add_edges(*first, step, edges_);
    std::sort(edges_.begin(), edges_.end());
    for (std::size_t i = 1; i < edges_.size(); ++i) {
      const double from = edges_[i - 1], to = edges_[i];
      if (!disc.shines((*first + (from + to) / 2 * step).normalized())) continue;
      for (const auto& [node, weight] : kQuadrature) {
        const Vec3 direction = (*first + std::lerp(from, to, node) * step).normalized();
        add_sample(direction, share * (to - from) * weight * disc.radiance(direction, pixel.step_rad), pixel);
      }
    }
  }

  // Adds a sample's radiance, which is weighted by its share of the pixel: to the pixel, or at a border to rays().
  void add_sample(const Vec3& direction, double value, Pixel& pixel) {
    if (!pixel.at_border) {
      // Pixels without data count as sky. The Moon still occludes directions far below its limb, as it does for rays.
      const bool free = !moon_ || std::isinf(range_below_terrain_m({pixel.view.position(), direction}));
      if (free) pixel.radiance += value;
    } else if (value > 0) {
      rays_.push_back({pixel.view.position(), direction});
      pixel_.push_back(pixel.index);
      value_.push_back(static_cast<float>(value));
    }
  }

  std::size_t pixel_index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
  }

  // Gauss-Legendre nodes and weights on the interval 0 to 1: right to 0.1 % for radiance that rises like a square root
  // from both ends.
  static constexpr std::array<std::pair<double, double>, 8> kQuadrature{{{0.0198550717512319, 0.0506142681451881},
                                                                         {0.1016667612931866, 0.1111905172266872},
                                                                         {0.2372337950418355, 0.1568533229389436},
                                                                         {0.4082826787521751, 0.1813418916891810},
                                                                         {0.5917173212478249, 0.1813418916891810},
                                                                         {0.7627662049581645, 0.1568533229389436},
                                                                         {0.8983332387068134, 0.1111905172266872},
                                                                         {0.9801449282487681, 0.0506142681451881}}};

  const RowViews& views_;
  std::span<const double> range_m_;
  const StopToken& stop_;
  int width_, height_;
  int neighbours_;             // neighbours to each side that decide about a border
  bool moon_;                  // the scene includes the Moon
  std::vector<double> edges_;  // parameters along a line; a member so that its memory is reused
  // Samples of pixels at a border: their rays, pixels and radiance.
  std::vector<Ray> rays_;
  std::vector<std::size_t> pixel_;
  std::vector<float> value_;
};

}  // namespace

void add_discs(const FrameRequest& request, std::span<const double> range_m, const RenderContext& context,
               std::vector<float>& radiance) {
  if (!wants_discs(request)) return;
  const RowViews views(request.camera, request.pose, request.shutter, context.stop);
  DiscPainter painter(request, views, range_m, context.stop);
  FrameRequest discs_only = request;
  discs_only.sky->stars.reset();
  discs_only.sky->planets = false;
  const SkyObserver observer(request.sky->utc, views.reference().position(), request.sky->velocity_m_s,
                             request.sky->states);
  const EarthFigure earth(observer);
  for (const SkyObject& object : sky_around(discs_only, views, 0, context.stop)) {
    if (object.kind == SkyKind::sun) painter.paint(SunDisc(object, request.sun.limb_darkening, earth), radiance);
    if (object.kind == SkyKind::earth)
      painter.paint(EarthDisc(object, earth, observer, request.sky->earth_map, context.stop), radiance);
  }
  painter.add_visible(what_hides(painter.rays(), request.objects, request.terrain, context), radiance);
}

}  // namespace selenograph::engine
