#include "dem/grid/post_grid.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

namespace selenograph::dem {

std::optional<int> lattice_level_of(const GeographicGrid& g, int posts_along) {
  constexpr double kTolerance = 1e-9;  // share of a post: covers the rounding of decimals in labels
  const double ppd = std::round(g.lat_posts_per_degree);
  if (ppd < 1 || ppd > 1 << 24 || !std::has_single_bit(static_cast<std::uint32_t>(ppd))) return std::nullopt;
  // Multiply the error of the resolution by the number of posts: it adds up along the raster.
  for (const double p : {g.lat_posts_per_degree, g.lon_posts_per_degree})
    if (std::abs(p / ppd - 1) * posts_along > kTolerance) return std::nullopt;
  for (const double first : {g.first_lat_deg, g.first_lon_deg})
    if (std::abs(first * ppd - std::round(first * ppd)) > kTolerance) return std::nullopt;
  return std::countr_zero(static_cast<std::uint32_t>(ppd));
}

namespace {

constexpr double kNowhere = -1e9;
// Radius of an orthographic map's disc, less 2 um. A pole on the limb is thus outside: the border's longitude would
// have a step of 180 degrees at it.
constexpr double kLimb_m = kMoonRadius_m * (1 - 1e-12);

bool is_cylindrical(const MapPlane& plane) {
  return plane.projection == MapProjection::mercator || plane.projection == MapProjection::transverse_mercator;
}

MapPoint period_of(const MapPlane& plane) {
  const double around_m = 2 * std::numbers::pi * kMoonRadius_m * plane.scale;
  if (plane.projection == MapProjection::mercator) return {around_m, 0};
  if (plane.projection == MapProjection::transverse_mercator) return {0, around_m};
  return {};
}

// Returns v shifted by whole periods to the value nearest to `middle`.
double nearest_to(double v, double middle, double period) {
  return period > 0 ? v + period * std::round((middle - v) / period) : v;
}

// Returns the largest value of a function along the closed border, to better than its samples: a golden-section search
// around each sample that may be near the maximum. f(i, t): value at position t, close to sample i. The function must
// be smooth, or have one corner, between adjacent samples.
template <typename Function>
double highest(int samples, const Function& f) {
  std::vector<double> values(static_cast<std::size_t>(samples));
  for (int i = 0; i < samples; ++i) values[static_cast<std::size_t>(i)] = f(i, i);
  double best = *std::max_element(values.begin(), values.end());
  for (int i = 0; i < samples; ++i) {
    const auto value = [&](int k) { return values[static_cast<std::size_t>((k + samples) % samples)]; };
    // Skip a sample whose surroundings cannot exceed the best value: the function rises beside it by no more than it
    // falls to both of its neighbours.
    const double max_rise = 2 * value(i) - value(i - 1) - value(i + 1);
    if (value(i) < value(i - 1) || value(i) < value(i + 1) || value(i) + max_rise <= best + 1e-10) continue;
    constexpr double kGolden = std::numbers::phi - 1;
    double low = i - 1, high = i + 1;
    for (int step = 0; step < 50; ++step) {
      const double a = high - kGolden * (high - low), b = low + kGolden * (high - low);
      if (f(i, a) < f(i, b))
        low = a;
      else
        high = b;
    }
    best = std::max(best, f(i, (low + high) / 2));
  }
  return best;
}

}  // namespace

PlanePosts::PlanePosts(const PlaneGrid& grid, int width, int height)
    : grid_(grid), columns_(width - 1), rows_(height - 1), transform_(grid.plane), period_(period_of(grid.plane)) {}

PostXY PlanePosts::posts_at(const std::optional<MapPoint>& p) const {
  if (!p) return {kNowhere, kNowhere};
  const MapPoint middle = at(columns_ / 2, rows_ / 2);
  const double x_m = nearest_to(p->x_m, middle.x_m, period_.x_m), y_m = nearest_to(p->y_m, middle.y_m, period_.y_m);
  // Clamp positions opposite to a stereographic plane's origin, which are nearly infinitely far away.
  const auto bounded = [](double v) { return std::clamp(v, kNowhere, -kNowhere); };
  return {bounded((x_m - grid_.first_x_m) / grid_.spacing_m), bounded((grid_.first_y_m - y_m) / grid_.spacing_m)};
}

bool PlanePosts::within_limb(const MapPoint& p) const {
  return grid_.plane.projection != MapProjection::orthographic || std::hypot(p.x_m, p.y_m) <= kLimb_m;
}

Geographic PlanePosts::position_at(const MapPoint& p) const {
  const double shrink = within_limb(p) ? 1 : kLimb_m / std::hypot(p.x_m, p.y_m);
  Geographic g = to_geographic(*transform_.direction({p.x_m * shrink, p.y_m * shrink}) * kMoonRadius_m);
  g.height_m = 0;
  return g;
}

Geographic PlanePosts::position(double x, double y) const { return position_at(at(x, y)); }

double PlanePosts::posts_per_degree() const {
  const MapPlane& plane = grid_.plane;
  const MapPoint middle = at(columns_ / 2, rows_ / 2);
  // By Snyder (7-3), (8-4) the scale is k0 cosh(v / (R k0)), v (from_contact_m) being the distance from the line where
  // the cylinder touches the sphere.
  const double from_contact_m = plane.projection == MapProjection::mercator ? middle.y_m : middle.x_m;
  const double stretch = is_cylindrical(plane) ? std::cosh(from_contact_m / (kMoonRadius_m * plane.scale)) : 1;
  return kMetresPerDegree * plane.scale * stretch / grid_.spacing_m;
}

// Returns a point of the border of the posts on the Moon; t from 0 to 4 runs once around, by 1 along each side of the
// raster. A point beyond the limb is moved onto the limb, toward the post nearest to the origin: raster and disc are
// convex, so the border stays one closed curve.
//
//   t=0 ______ t=1
//      |  .--.|        . limb; raster corners beyond it are cut off
//      | /    |
//   t=3 |_____| t=2
Geographic PlanePosts::border(double t) const {
  const double along = t - 4 * std::floor(t / 4);
  // The column rises along side 0 and falls along side 2; the row rises along side 1 and falls along side 3.
  const auto ramp = [](double v) { return std::clamp(v, 0.0, 1.0); };
  const MapPoint p = at(columns_ * (ramp(along) - ramp(along - 2)), rows_ * (ramp(along - 1) - ramp(along - 3)));
  if (within_limb(p)) return position_at(p);
  const MapPoint first = at(0, 0), last = at(columns_, rows_);
  const double x_m = std::clamp(0.0, first.x_m, last.x_m), y_m = std::clamp(0.0, last.y_m, first.y_m);
  // Solve |q + s (p - q)| = limb for s, q being the post nearest to the origin, by the quadratic formula.
  const double dx = p.x_m - x_m, dy = p.y_m - y_m, a = dx * dx + dy * dy, b = x_m * dx + y_m * dy,
               c = std::min(0.0, x_m * x_m + y_m * y_m - kLimb_m * kLimb_m);
  const double s = (std::sqrt(b * b - a * c) - b) / a;
  return position_at({x_m + s * dx, y_m + s * dy});
}

bool PlanePosts::contains(double x, double y) const {
  constexpr double kRounding = 1e-6;
  return x >= -kRounding && x <= columns_ + kRounding && y >= -kRounding && y <= rows_ + kRounding;
}

// Searches the border, where latitude and longitude have their extremes, unless a pole lies inside.
Footprint PlanePosts::footprint() const {
  constexpr int kSamples = 128;
  std::vector<Geographic> samples;
  for (int i = 0; i < kSamples; ++i) {
    samples.push_back(border(4.0 * i / kSamples));
    // Make longitudes continuous along the border, without steps of 360 degrees.
    if (i > 0)
      samples[static_cast<std::size_t>(i)].lon_deg =
          samples[static_cast<std::size_t>(i) - 1].lon_deg +
          std::remainder(samples.back().lon_deg - samples[static_cast<std::size_t>(i) - 1].lon_deg, 360);
  }
  const auto lat_deg = [&](int, double t) { return border(4 * t / kSamples).lat_deg; };
  const auto lon_deg = [&](int i, double t) {
    const double sample_deg = samples[static_cast<std::size_t>(i)].lon_deg;
    return sample_deg + std::remainder(border(4 * t / kSamples).lon_deg - sample_deg, 360);
  };
  const auto lowest = [&](const auto& f) { return -highest(kSamples, [&](int i, double t) { return -f(i, t); }); };
  Footprint f{lowest(lat_deg), highest(kSamples, lat_deg), -180, 180};
  bool holds_pole = false;  // then all longitudes are inside
  for (const double pole_lat_deg : {-90.0, 90.0}) {
    const std::optional<MapPoint> p = transform_.project(pole_lat_deg, 0);
    const PostXY pole_post = locate(pole_lat_deg, 0);
    if (!p || !within_limb(*p) || !contains(pole_post.x, pole_post.y)) continue;
    holds_pole = true;
    (pole_lat_deg < 0 ? f.south_deg : f.north_deg) = pole_lat_deg;
  }
  if (holds_pole) return f;
  const double west_deg = lowest(lon_deg), across_deg = highest(kSamples, lon_deg) - west_deg;
  if (across_deg >= 360) return f;
  f.west_deg = wrap_lon_deg(west_deg);
  f.east_deg = f.west_deg + across_deg;
  return f;
}

}  // namespace selenograph::dem
