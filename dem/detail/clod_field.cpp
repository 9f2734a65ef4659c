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

// A clod's outline and top. `u` and `v` are offsets from its centre along its own axes, in its radii along these.
class ClodShape {
 public:
  static constexpr std::size_t kSides = 5;

  explicit ClodShape(std::uint64_t shape_seed) {
    Draws draws(shape_seed, 0, 0, 0);
    const auto between = [&](double low, double high) { return low + (high - low) * draws.uniform(); };
    const double azimuth = between(0, 2 * std::numbers::pi);
    const double width = between(0.6, 1.0);
    // The size is two radii.
    u_ = {static_cast<float>(2 * std::cos(azimuth)), static_cast<float>(2 * std::sin(azimuth))};
    v_ = {static_cast<float>(-2 * std::sin(azimuth) / width), static_cast<float>(2 * std::cos(azimuth) / width)};
    for (std::size_t i = 0; i < kSides; ++i) {
      const double angle = (static_cast<double>(i) + between(-0.3, 0.3)) * 2 * std::numbers::pi / kSides,
                   distance = between(0.6, 0.95);
      side_u_[i] = static_cast<float>(std::cos(angle) / distance);
      side_v_[i] = static_cast<float>(std::sin(angle) / distance);
    }
    tilt_u_ = static_cast<float>(between(-1, 1)) * kMaxTilt;
    tilt_v_ = static_cast<float>(between(-1, 1)) * kMaxTilt;
    height_over_size_ = static_cast<float>(between(kMinHeightOverSize, kMaxHeightOverSize));
  }

  // Returns the height at an offset from the centre, all in sizes; 0 outside.
  float height(float east, float north) const {
    const float u = u_[0] * east + u_[1] * north, v = v_[0] * east + v_[1] * north;
    const float ellipse = u * u + v * v;
    if (ellipse >= 1) return 0;
    float polygon = 0;
    for (std::size_t i = 0; i < kSides; ++i) polygon = std::max(polygon, side_u_[i] * u + side_v_[i] * v);
    constexpr float kEllipseWeight = 0.45F;
    const float outward = kEllipseWeight * ellipse + (1 - kEllipseWeight) * polygon * polygon;
    return outward >= 1 ? 0 : height_over_size_ * std::sqrt(1 - outward) * (1 + tilt_u_ * u + tilt_v_ * v);
  }
  // Upper bound of height() over the height of a level top: 1.15, at full tilt toward the widest corner of the
  // pentagon.
  static constexpr float kMaxRelativeHeight = 1.2F;

 private:
  std::array<float, 2> u_, v_;  // factors of the offsets to the east and to the north
  std::array<float, kSides> side_u_{}, side_v_{};
  float tilt_u_, tilt_v_, height_over_size_;
};

const MeanLump& mean_clod() {
  static const MeanLump mean = measure_lumps<ClodShape>();
  return mean;
}

// Returns the law by which each octave covers the same share of ground: the number per m^2 above D is c D^-2. Then the
// mean of D^2 within an octave from d to 2 d is 8/3 ln 2 d^2, and the octave has 3/4 c d^-2 clods per m^2: together
// they cover 2 ln 2 c times the mean area over D^2.
SizeFrequency frequency_of(const ClodLaw& law) {
  if (law.cover == 0) return {};
  return {{{law.cover / (2 * std::numbers::ln2 * mean_clod().area), 2}}};
}

}  // namespace

ClodField::ClodField(const ClodLaw& law, const Region& region_of_centres)
    : law_(law),
      region_(region_of_centres),
      cells_(law.seed ^ kClods, frequency_of(law), law.smallest_m, law.largest_m, kMaxDensity) {
  // By the same law the sum of D^3 over the clods between two sizes is twice c times the difference of the sizes, per
  // m^2. Overlaps and the cut at kMaxDensity take a tenth of it, some tenths of a millimetre.
  if (law.cover > 0) mean_m_per_m_ = 2 * frequency_of(law).laws[0].per_m2 * mean_clod().volume;
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
  const double radius_m = ball.radius_m + cells_.largest_m(octave) / 2;
  std::vector<float> clod_heights_m(heights_m.size(), 0.F);
  const auto add_clod = [&](Draws& draws, const Vec3& centre, double size_m) {
    const double rank = draws.uniform();
    const std::uint64_t shape_seed = draws.bits();
    if ((centre - ball.direction).norm() * kMoonRadius_m > radius_m || !region_.holds(centre) ||
        rank * kMaxDensity > patchiness(centre))
      return;
    const ClodShape shape(shape_seed);
    visit_posts_within(grid, centre, size_m, [&](std::size_t post, float east, float north) {
      clod_heights_m[post] = std::max(clod_heights_m[post], static_cast<float>(size_m) * shape.height(east, north));
    });
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
