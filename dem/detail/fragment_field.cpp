#include "dem/detail/fragment_field.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "dem/base/noise.h"
#include "dem/detail/footprints.h"

namespace selenograph::dem {
namespace {

constexpr std::uint64_t kFragments = 0x66726167;  // makes the fragments' seed differ from others of the same preset
constexpr double kMinAspect = 0.18, kMaxAspect = 0.5;

// A convex body: the lowest of some planes, each given by its height above the centre and its slopes. All lengths are
// in sizes of the fragment, horizontal ones from its centre to the east and to the north.
class FragmentShape {
 public:
  static constexpr std::size_t kPlanes = 14;

  explicit FragmentShape(std::uint64_t shape_seed) {
    Draws draws(shape_seed, 0, 0, 0);
    const auto between = [&](double low, double high) { return low + (high - low) * draws.uniform(); };
    const double second = between(0.31, 0.45), azimuth = between(0, 2 * std::numbers::pi);
    const double cos_azimuth = std::cos(azimuth), sin_azimuth = std::sin(azimuth);
    const double top = between(kMinAspect, kMaxAspect);
    for (std::size_t i = 0; i < kPlanes; ++i) {
      // The golden ratio spreads the planes around the body: two on top, six on its shoulders, six at its sides.
      const double around = (static_cast<double>(i) * 0.381966 + between(-0.08, 0.08)) * 2 * std::numbers::pi;
      const double up = i < 2 ? between(0.85, 1.0) : i < 8 ? between(0.35, 0.85) : between(0.1, 0.35);
      const double level = std::sqrt(1 - up * up);
      const double along = level * std::cos(around), across = level * std::sin(around);
      // The plane touches the ellipsoid, or cuts off up to a sixth.
      const double touch = std::sqrt(0.25 * along * along + second * second * across * across + top * top * up * up) *
                           between(0.84, 1.0);
      height_[i] = static_cast<float>(std::min(touch / up, 8.0));
      east_[i] = static_cast<float>((cos_azimuth * along - sin_azimuth * across) / up);
      north_[i] = static_cast<float>((sin_azimuth * along + cos_azimuth * across) / up);
    }
    brightness_deviate_ = std::clamp(draws.normal(), -2.0, 2.0);
  }

  // Returns the height over the ground; 0 outside.
  float height(float east, float north) const {
    if (east * east + north * north >= 0.25F) return 0;
    float lowest = static_cast<float>(kMaxAspect);
    for (std::size_t i = 0; i < kPlanes; ++i)
      lowest = std::min(lowest, height_[i] - east_[i] * east - north_[i] * north);
    return std::max(lowest, 0.F);
  }
  double brightness_deviate() const { return brightness_deviate_; }

 private:
  std::array<float, kPlanes> height_{}, east_{}, north_{};
  double brightness_deviate_ = 0;
};

const MeanLump& mean_fragment() {
  static const MeanLump mean = measure_lumps<FragmentShape>();
  return mean;
}

// Returns the largest diameter of fragments; without fragments it equals the smallest.
double largest_fragment_m(const RockLaw& law) {
  return law.smallest_fragment_m > 0 && !law.frequency.laws.empty() ? law.smallest_m : 1;
}
double smallest_fragment_m(const RockLaw& law) {
  return std::min(law.smallest_fragment_m > 0 ? law.smallest_fragment_m : 1, largest_fragment_m(law));
}

}  // namespace

FragmentField::FragmentField(const RockLaw& law, const Region& region_of_centres)
    : law_(law),
      region_(region_of_centres),
      cells_(law.seed ^ kFragments, law.frequency, smallest_fragment_m(law), largest_fragment_m(law)) {
  for (int octave = smallest_octave(); octave <= largest_octave(); ++octave) means_.push_back(measure(octave));
}

// Integrates over the octave's diameters: the number per m^2 times area and volume of a fragment.
FragmentField::Means FragmentField::measure(int octave) const {
  constexpr int kSizes = 32;
  const double smallest_m = std::max(smallest_fragment_m(law_), std::ldexp(1.0, octave));
  const double ratio = cells_.largest_m(octave) / smallest_m;
  Means means;
  for (int i = 0; i < kSizes; ++i) {
    const double low_m = smallest_m * std::pow(ratio, static_cast<double>(i) / kSizes);
    const double high_m = smallest_m * std::pow(ratio, (i + 1.0) / kSizes);
    const double area = law_.frequency.between(low_m, high_m) * low_m * high_m;
    means.height_m += area * std::sqrt(low_m * high_m) * mean_fragment().volume;
    means.brighter += area * mean_fragment().area * law_.albedo_variation * kBrighter;
  }
  return means;
}

double FragmentField::max_height_m(int octave) const { return kMaxAspect * cells_.largest_m(octave); }

void FragmentField::add(const DirectionGrid& grid, int octave, std::span<const double> shares,
                        std::span<double> heights_m, const Marks& marks, const StopToken& stop) const {
  const BoundingBall ball = ball_around(grid);
  const double radius_m = ball.radius_m + cells_.largest_m(octave) / 2;
  // Surface of the fragments at the positions; height 0: none.
  struct Top {
    float height_m = 0, brighter = 0;
  };
  std::vector<Top> tops(heights_m.size());
  const auto add_fragment = [&](Draws& draws, const Vec3& centre, double size_m) {
    const std::uint64_t shape_seed = draws.bits();
    if ((centre - ball.direction).norm() * kMoonRadius_m > radius_m || !region_.holds(centre)) return;
    const FragmentShape shape(shape_seed);
    const auto brighter =
        static_cast<float>(law_.albedo_variation * (kBrighter + kBrighterScatter * shape.brightness_deviate()));
    visit_posts_within(grid, centre, size_m, [&](std::size_t post, float east, float north) {
      const float height_m = static_cast<float>(size_m) * shape.height(east, north);
      if (height_m > tops[post].height_m) tops[post] = {height_m, brighter};
    });
  };
  cells_.cells_near(octave, ball.direction, radius_m / kMoonRadius_m, stop,
                    [&](const SizeCells::Cell& cell) { cells_.draw_cell(cell, add_fragment); });
  const Means& means = means_[index(octave)];
  for (std::size_t i = 0; i < tops.size(); ++i) {
    const double share = shares.empty() ? 1 : shares[i];
    heights_m[i] += static_cast<double>(tops[i].height_m) - share * means.height_m;
    if (!marks.on_fragment.empty() && tops[i].height_m > 0) marks.on_fragment[i] = 1;
    if (!marks.factor.empty()) marks.factor[i] += static_cast<double>(tops[i].brighter) - share * means.brighter;
  }
}

double FragmentField::area_m2(int octave, const Footprint& box, const StopToken& stop) const {
  double area_m2 = 0;
  cells_.in_box(octave, box, stop, [&](Draws& draws, const Vec3& centre, double size_m) {
    draws.bits();
    if (holds(box, to_geographic(centre * kMoonRadius_m)) && region_.holds(centre))
      area_m2 += std::numbers::pi / 4 * size_m * size_m;
  });
  return area_m2;
}

}  // namespace selenograph::dem
