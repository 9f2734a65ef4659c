#include "engine/verify/error_measures.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "dem/base/parallel.h"
#include "dem/base/quantile.h"

namespace selenograph::engine {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

bool is_lit(float fraction) { return fraction > 0.5F; }

struct PointError {
  double metres = kNaN, pixels = kNaN;
};

// Returns the error of a visible point against the finest surface vertically above or below it.
PointError error_of(const View& view, const dem::Terrain& terrain, const Vec3& point) {
  if (!point.is_finite()) return {};
  const Geographic g = to_geographic(point);
  const double ground = terrain.height(g.lat_deg, g.lon_deg).height_m;
  const auto pixel = view.project(point), true_pixel = view.project(to_cartesian({g.lat_deg, g.lon_deg, ground}));
  PointError error{std::abs(g.height_m - ground), kNaN};
  if (pixel && true_pixel) error.pixels = std::hypot(pixel->x - true_pixel->x, pixel->y - true_pixel->y);
  return error;
}

// Returns the length of shadow edges, pixels: the number of neighbour pairs with different flags, corrected for edges
// at all angles (a line of length 1 crosses 4 / pi grid lines on average).
double edge_length(int width, int height, const std::vector<float>& lit) {
  std::size_t pairs = 0;
  const auto at = [&](int x, int y) {
    return lit[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)];
  };
  const auto differ = [](float a, float b) { return !std::isnan(a) && !std::isnan(b) && is_lit(a) != is_lit(b); };
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      if (x + 1 < width) pairs += differ(at(x, y), at(x + 1, y));
      if (y + 1 < height) pairs += differ(at(x, y), at(x, y + 1));
    }
  return static_cast<double>(pairs) * std::numbers::pi / 4;
}

}  // namespace

Spread spread_of(std::vector<double> values) {
  std::erase_if(values, [](double v) { return std::isnan(v); });
  if (values.empty()) return {};
  const auto quantile = [&](double q) {
    return ranked(values, static_cast<std::size_t>(std::lround(q * static_cast<double>(values.size() - 1))));
  };
  return {quantile(0.5), quantile(0.999), *std::max_element(values.begin(), values.end())};
}

double distance_to_flag(int width, int height, const std::vector<float>& reference, int x, int y, bool lit) {
  const double farthest = std::hypot(width, height);
  double nearest2 = farthest * farthest;
  // Search the borders of squares of growing radius. Beyond the best distance found nothing can be nearer.
  for (int radius = 1; radius < std::max(width, height) && radius * radius <= nearest2; ++radius)
    for (int v = std::max(0, y - radius); v <= std::min(height - 1, y + radius); ++v) {
      const bool full_row = v == y - radius || v == y + radius;
      for (int u = x - radius; u <= x + radius; u += full_row ? 1 : 2 * radius) {
        if (u < 0 || u >= width) continue;
        const float flag =
            reference[static_cast<std::size_t>(v) * static_cast<std::size_t>(width) + static_cast<std::size_t>(u)];
        if (!std::isnan(flag) && is_lit(flag) == lit)
          nearest2 = std::min(nearest2, static_cast<double>((u - x) * (u - x) + (v - y) * (v - y)));
      }
    }
  return std::sqrt(nearest2) - 0.5;
}

void ErrorCollector::add_geometry(const View& view, const dem::Terrain& terrain, const std::vector<double>& position_m,
                                  const FrameReport& report) {
  std::vector<PointError> errors(position_m.size() / 3);
  in_parallel_pieces(errors.size(), 4096, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t i = first; i < past_last; ++i)
      errors[i] = error_of(view, terrain, {position_m[3 * i], position_m[3 * i + 1], position_m[3 * i + 2]});
  });
  // Tolerate the engine's own rounding, for a bound of zero: see the distances table among the hard cases.
  constexpr double kRounding_m = 1e-6, kRounding_px = 1e-6;
  for (const PointError& e : errors) {
    if (std::isnan(e.metres)) continue;
    errors_m_.push_back(e.metres);
    if (!std::isnan(e.pixels)) errors_px_.push_back(e.pixels);
    points_beyond_bound_m_ += e.metres > report.lod_error_m + kRounding_m;
    points_beyond_bound_px_ += e.pixels > report.lod_error_px + kRounding_px;
    points_beyond_expected_px_ += e.pixels > report.expected_error_px + kRounding_px;
  }
}

void ErrorCollector::add_shadows(int width, int height, const std::vector<float>& lit,
                                 const std::vector<float>& reference) {
  edge_length_px_ += edge_length(width, height, reference);
  pixels_ += lit.size();
  for (std::size_t i = 0; i < lit.size(); ++i) {
    wrong_hits_ += std::isnan(lit[i]) != std::isnan(reference[i]);
    if (std::isnan(lit[i]) || std::isnan(reference[i])) continue;
    ++flags_compared_;
    if (is_lit(lit[i]) == is_lit(reference[i])) continue;
    ++wrong_flags_;
    const int x = static_cast<int>(i % static_cast<std::size_t>(width)),
              y = static_cast<int>(i / static_cast<std::size_t>(width));
    displacements_px_.push_back(distance_to_flag(width, height, reference, x, y, is_lit(lit[i])));
  }
}

void ErrorCollector::add_radiance(const std::vector<float>& radiance, const std::vector<float>& reference) {
  for (std::size_t i = 0; i < radiance.size(); ++i) {
    const double truth = static_cast<double>(reference[i]);
    radiance_errors_.push_back(std::abs(static_cast<double>(radiance[i]) - truth));
    if (!(truth > 0)) continue;
    reference_radiance_ += truth;
    ++sunlit_;
  }
}

ErrorMeasures ErrorCollector::result() const {
  ErrorMeasures out;
  out.geometric_m = spread_of(errors_m_);
  out.geometric_px = spread_of(errors_px_);
  const auto share = [](std::size_t count, std::size_t total) {
    return total ? static_cast<double>(count) / static_cast<double>(total) : 0.0;
  };
  out.within_bound_m = 1 - share(points_beyond_bound_m_, errors_m_.size());
  out.within_bound_px = 1 - share(points_beyond_bound_px_, errors_px_.size());
  out.within_expected_px = 1 - share(points_beyond_expected_px_, errors_px_.size());
  out.wrong_hits = share(wrong_hits_, pixels_);
  out.wrong_shadow_flags = share(wrong_flags_, flags_compared_);
  // Each wrong pixel is one square pixel of the area between both edges.
  if (edge_length_px_ > 0) out.shadow_edge_mean_px = static_cast<double>(wrong_flags_) / edge_length_px_;
  out.shadow_edge_px = spread_of(displacements_px_);
  if (sunlit_ == 0) return out;
  const double mean = reference_radiance_ / static_cast<double>(sunlit_);
  double squares = 0;
  for (const double e : radiance_errors_) squares += e * e;
  out.radiance_rms = std::sqrt(squares / static_cast<double>(radiance_errors_.size())) / mean;
  out.radiance_p999 = spread_of(radiance_errors_).p999 / mean;
  return out;
}

}  // namespace selenograph::engine
