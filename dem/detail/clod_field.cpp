#include "dem/detail/clod_field.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "dem/base/noise.h"

namespace selenograph::dem {
namespace {

constexpr std::uint64_t kClods = 0xa0761d6478bd642f;  // makes the clods' seed differ from others of the same preset
constexpr double kMaxDensity = 3;                     // of a patch, over the mean
constexpr double kMinHeightOverSize = 0.06, kMaxHeightOverSize = 0.25;
constexpr float kMaxTilt = 0.35F;  // of the top along one axis: relative change of height from the centre to the edge

// A clod's outline and top, in radii from its centre along its own axes.
class ClodShape {
 public:
  static constexpr std::size_t kSides = 5;

  explicit ClodShape(std::uint64_t shape_seed) {
    Draws draws(shape_seed, 0, 0, 0);
    const auto between = [&](double low, double high) { return low + (high - low) * draws.uniform(); };
    const double azimuth = between(0, 2 * std::numbers::pi);
    cos_azimuth_ = std::cos(azimuth);
    sin_azimuth_ = std::sin(azimuth);
    width_ = between(0.6, 1.0);
    for (std::size_t i = 0; i < kSides; ++i) {
      const double angle = (static_cast<double>(i) + between(-0.3, 0.3)) * 2 * std::numbers::pi / kSides,
                   distance = between(0.6, 0.95);
      side_u_[i] = static_cast<float>(std::cos(angle) / distance);
      side_v_[i] = static_cast<float>(std::sin(angle) / distance);
    }
    tilt_u_ = static_cast<float>(between(-1, 1)) * kMaxTilt;
    tilt_v_ = static_cast<float>(between(-1, 1)) * kMaxTilt;
    height_over_size_ = between(kMinHeightOverSize, kMaxHeightOverSize);
  }

  double height_over_size() const { return height_over_size_; }
  // Returns the clod's two horizontal axes (MOON_ME), each divided by the clod's radius along it: their dot products
  // with an offset from its centre are u and v. `radius` and offsets are chords of the unit sphere.
  std::array<Vec3, 2> axes(const EastNorthUp& local, double radius) const {
    return {(cos_azimuth_ * local.east + sin_azimuth_ * local.north) / radius,
            (cos_azimuth_ * local.north - sin_azimuth_ * local.east) / (radius * width_)};
  }
  // Returns the height at (u, v) relative to height_over_size() times the size; 0 outside.
  float height(float u, float v) const {
    const float ellipse = u * u + v * v;
    if (ellipse >= 1) return 0;
    float polygon = 0;
    for (std::size_t i = 0; i < kSides; ++i) polygon = std::max(polygon, side_u_[i] * u + side_v_[i] * v);
    constexpr float kEllipseWeight = 0.45F;
    const float outward = kEllipseWeight * ellipse + (1 - kEllipseWeight) * polygon * polygon;
    return outward >= 1 ? 0 : std::sqrt(1 - outward) * (1 + tilt_u_ * u + tilt_v_ * v);
  }
  // Upper bound of height(): 1.15, at full tilt toward the widest corner of the pentagon.
  static constexpr float kMaxRelativeHeight = 1.2F;

 private:
  double cos_azimuth_, sin_azimuth_, width_, height_over_size_;
  std::array<float, kSides> side_u_{}, side_v_{};
  float tilt_u_, tilt_v_;
};

// Mean area of clods over size^2, and mean volume over size^3.
struct MeanShape {
  double area = 0, volume = 0;
};
MeanShape measure_shapes() {
  constexpr int kShapes = 512, kSteps = 24;
  MeanShape mean;
  for (int n = 0; n < kShapes; ++n) {
    const ClodShape shape(static_cast<std::uint64_t>(n) * kSplitMixStep);
    const std::array<Vec3, 2> axes = shape.axes({Vec3::UnitX(), Vec3::UnitY(), Vec3::UnitZ()}, 0.5);
    for (int i = 0; i < kSteps; ++i)
      for (int j = 0; j < kSteps; ++j) {
        const Vec3 sample((i + 0.5) / kSteps - 0.5, (j + 0.5) / kSteps - 0.5, 0);
        const float height =
            shape.height(static_cast<float>(axes[0].dot(sample)), static_cast<float>(axes[1].dot(sample)));
        mean.area += height > 0;
        mean.volume += static_cast<double>(height) * shape.height_over_size();
      }
  }
  constexpr double kSamples = double{kShapes} * kSteps * kSteps;
  return {mean.area / kSamples, mean.volume / kSamples};
}
const MeanShape& mean_shape() {
  static const MeanShape mean = measure_shapes();
  return mean;
}

// Returns the law by which each octave covers the same share of ground: the number per m^2 above D is c D^-2. Then the
// mean of D^2 within an octave from d to 2 d is 8/3 ln 2 d^2, and the octave has 3/4 c d^-2 clods per m^2: together
// they cover 2 ln 2 c times the mean area over D^2.
SizeFrequency frequency_of(const ClodLaw& law) {
  if (law.cover == 0) return {};
  return {{{law.cover / (2 * std::numbers::ln2 * mean_shape().area), 2}}};
}

}  // namespace

ClodField::ClodField(const ClodLaw& law, const Region& region_of_centres)
    : law_(law),
      region_(region_of_centres),
      cells_(law.seed ^ kClods, frequency_of(law), law.smallest_m, law.largest_m, kMaxDensity) {
  // By the same law the sum of D^3 over the clods between two sizes is twice c times the difference of the sizes, per
  // m^2. Overlaps and the cut at kMaxDensity take a tenth of it, some tenths of a millimetre.
  if (law.cover > 0) mean_m_per_m_ = 2 * frequency_of(law).laws[0].per_m2 * mean_shape().volume;
}

double ClodField::mean_m(int octave) const {
  return mean_m_per_m_ * (cells_.largest_m(octave) - std::max(law_.smallest_m, std::ldexp(1.0, octave)));
}

double ClodField::max_height_m(int octave) const {
  return ClodShape::kMaxRelativeHeight * kMaxHeightOverSize * cells_.largest_m(octave);
}

double ClodField::patchiness(const Vec3& direction) const {
  const auto noise_of = [&](double wavelength_m, std::uint32_t number) {
    const Vec3 p = direction * (kMoonRadius_m / wavelength_m);
    return perlin_noise<double>(p.x(), p.y(), p.z(), static_cast<std::uint32_t>(split_mix(law_.seed + number)));
  };
  // The mean of the exponential is 1.35 with these factors.
  return std::min(kMaxDensity, std::exp(2.2 * noise_of(3.1, 1) + 1.8 * noise_of(0.7, 2)) / 1.35);
}

void ClodField::add(const DirectionGrid& grid, int octave, std::span<const double> shares, std::span<double> heights_m,
                    std::span<float> on_clod, const StopToken& stop) const {
  const BoundingBall ball = ball_around(grid);
  const std::size_t columns = grid.columns();
  const double radius_m = ball.radius_m + cells_.largest_m(octave) / 2;
  std::vector<float> clod_heights_m(heights_m.size(), 0.F);
  const auto add_clod = [&](Draws& draws, const Vec3& centre, double size_m) {
    const double rank = draws.uniform();
    const std::uint64_t shape_seed = draws.bits();
    if ((centre - ball.direction).norm() * kMoonRadius_m > radius_m || !region_.holds(centre) ||
        rank * kMaxDensity > patchiness(centre))
      return;
    const ClodShape shape(shape_seed);
    const double reach = size_m / 2 / kMoonRadius_m;  // a chord of the unit sphere, as all distances here
    const std::array<Vec3, 2> axes = shape.axes(local_axes(centre), reach);
    const auto height_m = static_cast<float>(shape.height_over_size() * size_m);
    const auto [first_column, past_column] = columns_within(grid, centre, reach);
    const auto [first_row, past_row] = rows_within(grid, centre, reach);
    for (std::size_t r = first_row; r < past_row; ++r) {
      const bool past_pole = grid.cos_lat[r] < 0;  // on the opposite meridian, where the range of columns is not valid
      for (std::size_t c = past_pole ? 0 : first_column; c < (past_pole ? columns : past_column); ++c) {
        const Vec3 from_centre = grid.direction(r, c) - centre;
        float& highest = clod_heights_m[r * columns + c];
        highest = std::max(highest, height_m * shape.height(static_cast<float>(axes[0].dot(from_centre)),
                                                            static_cast<float>(axes[1].dot(from_centre))));
      }
    }
  };
  cells_.cells_near(octave, ball.direction, radius_m / kMoonRadius_m, stop,
                    [&](const SizeCells::Cell& cell) { cells_.draw_cell(cell, add_clod); });
  const double mean = mean_m(octave);
  for (std::size_t i = 0; i < heights_m.size(); ++i) {
    heights_m[i] += static_cast<double>(clod_heights_m[i]) - (shares.empty() ? mean : shares[i] * mean);
    if (!on_clod.empty() && clod_heights_m[i] > 0) on_clod[i] = 1;
  }
}

}  // namespace selenograph::dem
