#include "engine/verify/disc_image.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "engine/radiometry/brdf.h"
#include "engine/radiometry/spectrum.h"
#include "engine/sensor/optics.h"

namespace selenograph::engine {
namespace {

// Returns the point where a pixel's ray hits the sphere.
std::optional<Vec3> point_on_sphere(const View& view, double x_px, double y_px) {
  const auto ray = view.ray(x_px, y_px);
  return ray ? on_sphere(view.position(), ray->normalized()) : std::nullopt;
}

// Returns the radiance at a position in pixels, interpolated bilinearly and clamped to the image.
double sample(const DiscImage& image, double x, double y) {
  const int column = std::clamp(static_cast<int>(std::floor(x)), 0, image.width - 2),
            row = std::clamp(static_cast<int>(std::floor(y)), 0, image.height - 2);
  const auto at = [&](int c, int r) {
    return static_cast<double>(image.radiance[static_cast<std::size_t>(r) * static_cast<std::size_t>(image.width) +
                                              static_cast<std::size_t>(c)]);
  };
  const double fx = std::clamp(x - column, 0.0, 1.0), fy = std::clamp(y - row, 0.0, 1.0);
  return std::lerp(std::lerp(at(column, row), at(column + 1, row), fx),
                   std::lerp(at(column, row + 1), at(column + 1, row + 1), fx), fy);
}

// Returns the sum of squared second differences along columns, after undoing the scan's displacement of lines. It is
// smallest if the displacement is right: adjacent lines then match.
double roughness(const DiscImage& image, const SpinScan& scan) {
  std::vector<double> above, middle, below;
  double sum = 0;
  for (int y = 0; y < image.height; ++y) {
    above = std::move(middle);
    middle = std::move(below);
    below.clear();
    for (int x = 0; x < image.width; ++x) below.push_back(sample(image, x + scan.displacement_px(y, image.height), y));
    if (y < 2) continue;
    for (std::size_t x = 0; x < below.size(); ++x) sum += std::pow(above[x] - 2 * middle[x] + below[x], 2);
  }
  return sum;
}

// Returns the distance from the disc's centre along an outward ray at which the light falls to half of the maximum just
// inside the limb.
std::optional<double> edge_px(const DiscImage& image, const Eigen::Vector2d& centre, const Eigen::Vector2d& outward,
                              double radius_px) {
  constexpr double kInside = 0.95, kOutside = 1.06, kStep_px = 0.05;
  const auto light = [&](double r) {
    const Eigen::Vector2d point = centre + r * outward;
    return sample(image, point.x(), point.y());
  };
  double inside = 0;
  const auto steps = [&](double radii) { return static_cast<int>(std::ceil(radii * radius_px / kStep_px)); };
  for (int i = 0; i < steps(kInside - 0.9); ++i) inside = std::max(inside, light(0.9 * radius_px + i * kStep_px));
  if (!(inside > 0)) return std::nullopt;
  for (int i = 0; i < steps(kOutside - kInside); ++i)
    if (const double r = kOutside * radius_px - i * kStep_px; light(r) > inside / 2) return r;
  return std::nullopt;
}

// Returns the mean difference of the observed and the frame's limb, within 60 degrees of the Sun's side.
double limb_px(const DiscImage& observed, const DiscImage& frame, const FrameRequest& request, const View& view) {
  const auto centre = view.project(Vec3::Zero());
  if (!centre) return std::nan("");
  const Vec3 sun = view.moon_from_camera().transpose() * request.sun.direction;
  const double toward = std::atan2(sun.y(), sun.x());
  const double radius_px = request.camera.fx * kMoonRadius_m / view.position().norm();
  double sum = 0;
  int number = 0;
  for (int degrees = -60; degrees <= 60; ++degrees) {
    const double angle = toward + degrees * kRadiansPerDegree;
    const Eigen::Vector2d outward(std::cos(angle), std::sin(angle)), at(centre->x, centre->y);
    const auto real = edge_px(observed, at, outward, radius_px), drawn = edge_px(frame, at, outward, radius_px);
    if (!real || !drawn) continue;
    sum += *real - *drawn;
    ++number;
  }
  return number > 0 ? sum / number : std::nan("");
}

// A pixel of the disc and its region.
struct Pixel {
  std::size_t index;
  int region;  // index into kDiscRegions
};

// Returns the disc's pixels with their regions, which follow from the sphere's angles and the frame's brightness.
std::vector<Pixel> disc_pixels(const DiscImage& frame, const FrameRequest& request, const View& view) {
  constexpr double kLimb = 0.5, kTerminator = 0.3420201433256687, kMare = 0.85;  // cosines of 60 and 70 degrees
  const Brdf brdf(request.reflectance, band_of(request));
  const double irradiance_w_m2_um =
      solar_irradiance_w_m2(*request.band) / request.band->width_um() / std::pow(request.sun.distance_au, 2);
  std::vector<Pixel> pixels;
  for (int y = 0; y < frame.height; ++y)
    for (int x = 0; x < frame.width; ++x) {
      const auto point = point_on_sphere(view, x, y);
      if (!point) continue;
      const auto index =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(frame.width) + static_cast<std::size_t>(x);
      const Vec3 up = point->normalized(), toward = (view.position() - *point).normalized();
      const double mu0 = up.dot(request.sun.direction), mu = up.dot(toward);
      const double mean = direct_radiance(brdf, irradiance_w_m2_um, mu0, mu, toward.dot(request.sun.direction), 1);
      const bool dark = static_cast<double>(frame.radiance[index]) < kMare * mean;
      pixels.push_back({index, mu0 < kTerminator ? 3 : mu < kLimb ? 2 : dark ? 0 : 1});
    }
  return pixels;
}

}  // namespace

double SpinScan::displacement_px(int row, int height) const {
  const int turn = (height - 1 - row + first) / lines;
  // Lines begin at whole pixels, so only the fraction of the movement, -1/2 to 1/2, displaces them.
  const double moved_px = phase_px + step_px * turn;
  return moved_px - std::floor(moved_px + 0.5);
}

SpinScan scan_of(const std::vector<DiscImage>& channels, SpinScan scan) {
  constexpr int kPhases = 40;
  SpinScan best = scan;
  double min_roughness = std::numeric_limits<double>::infinity();
  for (scan.first = 0; scan.first < scan.lines; ++scan.first)
    for (int k = 0; k < kPhases; ++k) {
      scan.phase_px = static_cast<double>(k) / kPhases;
      double total_roughness = 0;
      for (const DiscImage& image : channels) total_roughness += roughness(image, scan);
      if (total_roughness < min_roughness) {
        min_roughness = total_roughness;
        best = scan;
      }
    }
  return best;
}

namespace {

// Appends the means of per_pixel x per_pixel pixels, row by row.
void append_means(const std::vector<float>& fine, int width, int per_pixel, std::vector<float>& out) {
  const int rows = static_cast<int>(fine.size()) / width;
  for (int y = 0; y < rows; y += per_pixel)
    for (int x = 0; x < width; x += per_pixel) {
      double sum = 0;
      for (int k = 0; k < per_pixel * per_pixel; ++k)
        sum += static_cast<double>(fine[static_cast<std::size_t>(y + k / per_pixel) * static_cast<std::size_t>(width) +
                                        static_cast<std::size_t>(x + k % per_pixel)]);
      out.push_back(static_cast<float>(sum / (per_pixel * per_pixel)));
    }
}

}  // namespace

DiscImage spread(const DiscImage& image, const Placement& by) {
  const int fine = image.per_pixel;
  PointSpread gaussian;
  gaussian.model = PointSpread::Model::gaussian;
  gaussian.sigma_px = by.sigma_px * fine;
  const SpreadKernel kernel(gaussian, 1, 1, 1);
  // Add the kernel's radius and one pixel of the result on all sides: lines are displaced by whole fine pixels first.
  const int r = kernel.radius(), border = r + fine, width = image.width + 2 * border;
  std::vector<float> bordered(static_cast<std::size_t>(width) * static_cast<std::size_t>(image.height + 2 * border),
                              0.F);
  for (int y = 0; y < image.height; ++y)
    std::copy_n(image.radiance.begin() + static_cast<std::ptrdiff_t>(y) * image.width, image.width,
                bordered.begin() + static_cast<std::ptrdiff_t>(y + border) * width + border);
  DiscImage out{image.width / fine, image.height / fine, {}};
  const double down = fine * by.dy_px;
  // Shifts are whole fine pixels by copying and the rest by the kernel. Adjacent lines of one displacement go together.
  const int whole_down = static_cast<int>(std::round(down));
  for (int y = 0, past = 0; y < out.height; y = past) {
    const double moved_px = by.scan.displacement_px(y, out.height);
    for (past = y + 1; past < out.height && by.scan.displacement_px(past, out.height) == moved_px;) ++past;
    const double across = fine * (by.dx_px + moved_px);
    const int whole_across = static_cast<int>(std::round(across));
    std::vector<float> lines, done;
    for (int line = y * fine; line < past * fine + 2 * r; ++line) {
      const auto from =
          bordered.begin() + static_cast<std::ptrdiff_t>(line + fine - whole_down) * width + fine - whole_across;
      lines.insert(lines.end(), from, from + image.width + 2 * r);
    }
    kernel.shifted(gaussian, across - whole_across, down - whole_down)
        .apply(lines, image.width, (past - y) * fine, done);
    append_means(done, image.width, fine, out.radiance);
  }
  return out;
}

double disc_correlation(const DiscImage& observed, const DiscImage& frame, const View& view) {
  double n = 0, sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;  // sums over the disc; a: observed, b: frame
  for (int y = 0; y < frame.height; ++y)
    for (int x = 0; x < frame.width; ++x) {
      if (!point_on_sphere(view, x, y)) continue;
      const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(frame.width) + static_cast<std::size_t>(x);
      const double a = static_cast<double>(observed.radiance[i]), b = static_cast<double>(frame.radiance[i]);
      n += 1;
      sa += a;
      sb += b;
      saa += a * a;
      sbb += b * b;
      sab += a * b;
    }
  return (n * sab - sa * sb) / std::sqrt((n * saa - sa * sa) * (n * sbb - sb * sb));
}

Placement registered(const DiscImage& observed, const DiscImage& frame, const View& view, Placement by) {
  // Climb in four directions, with steps that become finer, while the correlation grows.
  constexpr double kMax_px = 0.5;
  double best = disc_correlation(observed, spread(frame, by), view);
  for (const double step_px : {0.2, 0.1, 0.05})
    for (bool moved = true; moved;) {
      moved = false;
      for (const auto& [dx, dy] :
           {std::pair(step_px, 0.0), std::pair(-step_px, 0.0), std::pair(0.0, step_px), std::pair(0.0, -step_px)}) {
        Placement next = by;
        next.dx_px += dx;
        next.dy_px += dy;
        if (std::abs(next.dx_px) > kMax_px || std::abs(next.dy_px) > kMax_px) continue;
        const double correlation = disc_correlation(observed, spread(frame, next), view);
        if (correlation > best) {
          best = correlation;
          by = next;
          moved = true;
        }
      }
    }
  return by;
}

DiscComparison compare_disc(const DiscImage& observed, const DiscImage& frame, const FrameRequest& request) {
  const View view(request.camera, request.pose);
  const std::vector<Pixel> pixels = disc_pixels(frame, request, view);
  double observed_light = 0, frame_light = 0;
  for (const Pixel& p : pixels) {
    observed_light += static_cast<double>(observed.radiance[p.index]);
    frame_light += static_cast<double>(frame.radiance[p.index]);
  }
  DiscComparison out{disc_correlation(observed, frame, view),
                     observed_light / frame_light,
                     limb_px(observed, frame, request, view),
                     {}};
  std::array<double, 4> squares{}, light{}, number{};
  for (const Pixel& p : pixels) {
    const auto region = static_cast<std::size_t>(p.region);
    const double expected = out.scale * static_cast<double>(frame.radiance[p.index]);
    squares[region] += std::pow(static_cast<double>(observed.radiance[p.index]) - expected, 2);
    light[region] += expected;
    number[region] += 1;
  }
  for (std::size_t k = 0; k < out.residual.size(); ++k)
    out.residual[k] = number[k] > 0 ? std::sqrt(squares[k] / number[k]) / (light[k] / number[k]) : std::nan("");
  return out;
}

}  // namespace selenograph::engine
