#include "dem/detail/crater_brightness.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <utility>

#include "dem/base/parallel.h"
#include "dem/base/pool.h"
#include "dem/base/smoothstep.h"
#include "dem/detail/detail_kernels.h"

namespace selenograph::dem {
namespace {

using std::numbers::pi;

constexpr double kNewRim = 0.7;      // what a new crater adds at its rim where all that it digs up is immature
constexpr double kDimmest = 0.25;    // largest dimming of the dimmer zone over that
constexpr double kSteepWall = 0.3;   // what the steepest walls add
constexpr double kFaintest = 0.006;  // of what a crater adds; fainter ones add nothing

// Returns the factor of a crater's brightness from a uniform deviate: places differ.
double local_factor_of(double uniform) {
  constexpr double kDimmestPlace = 0.2, kBrightestPlace = 1.2;
  return kDimmestPlace + (kBrightestPlace - kDimmestPlace) * uniform;
}

// Returns the steepest slope of a crater's wall, of a shape whose height is one diameter (CraterShape::height), by its
// age.
double steepest_wall(double age) {
  constexpr int kAges = 65;
  static const auto table = [] {
    std::array<double, kAges> steepest{};
    for (int i = 0; i < kAges; ++i)
      for (double r = 0.4; r < 1; r += 0.02) {
        const auto height = [&](double at) {
          return CraterShape::of_all().height(at, CraterShape::kOldest * i / (kAges - 1));
        };
        constexpr double kStep = 0.02;  // crater radii: a diameter is two
        double& slope = steepest[static_cast<std::size_t>(i)];
        slope = std::max(slope, 2 * (height(r + kStep) - height(r - kStep)) / (2 * kStep));
      }
    return steepest;
  }();
  const double index = std::clamp(age / CraterShape::kOldest, 0.0, 1.0) * (kAges - 1);
  const auto i = std::min(static_cast<std::size_t>(index), table.size() - 2);
  return table[i] + (index - static_cast<double>(i)) * (table[i + 1] - table[i]);
}

// Shares of the brightness by position, for craters that are seen as far as `reach_radii`. A table by distance, in
// steps of 1 / kSteps of a radius; `bright`, `dim` and `wall` are shares of the members of Zones, `in_rays` is the
// share of the brightness there that is in rays.
class Profile {
 public:
  static constexpr double kSteps = 32;

  explicit Profile(double reach_radii) : reach(reach_radii) {
    const auto steps = static_cast<std::size_t>(reach * kSteps) + 2;
    for (std::size_t i = 0; i < steps; ++i) {
      const double r = static_cast<double>(i) / kSteps;
      const double outward = std::max(r, 1.0);
      const double floor = 0.75 + 0.25 * std::min(1.0, r / 0.5);
      const double spread = std::pow(std::max(outward / 1.25, 1.0), -2.4);
      const double edge = std::clamp((reach - r) / (0.4 * reach), 0.0, 1.0);
      const double from_dimmest = (outward - 3) / 1.2;
      bright.push_back(static_cast<float>(floor * spread * edge));
      dim.push_back(static_cast<float>(std::exp(-from_dimmest * from_dimmest) * edge));
      in_rays.push_back(static_cast<float>(std::clamp(0.8 * (outward - 1), 0.0, 1.0)));
      wall.push_back(static_cast<float>(smoothstep((r - 0.35) / 0.3) * smoothstep((1.06 - r) / 0.12)));
    }
    area_bright = area_of(bright);
    area_dim = area_of(dim);
    area_wall = area_of(wall);
  }

  double reach;                                         // crater radii
  std::vector<float> bright, dim, in_rays, wall;        // by distance
  double area_bright = 0, area_dim = 0, area_wall = 0;  // integrals over the plane, squared crater radii

 private:
  // Integrates a table, which is interpolated linearly, over the plane: Simpson's rule, exact for r times a line.
  static double area_of(const std::vector<float>& table) {
    double sum = 0;
    for (std::size_t i = 0; i + 1 < table.size(); ++i) {
      const double a = static_cast<double>(table[i]), b = static_cast<double>(table[i + 1]);
      const double r = static_cast<double>(i) / kSteps;
      const double next = r + 1 / kSteps;
      sum += (a * r + 4 * (a + b) / 2 * (r + next) / 2 + b * next) / 6;
    }
    return 2 * pi * sum / kSteps;
  }
};

constexpr double kWidestReach = 9;
const Profile& profile_of(int reach) {
  static const std::array<Profile, 3> profiles{Profile(3), Profile(5), Profile(kWidestReach)};
  return profiles[static_cast<std::size_t>(reach)];
}

// Waves of brightness around a crater: noise on circles, with so many wavelengths per radius.
struct Waves {
  double per_radius, amplitude;
};
constexpr std::array<Waves, 3> kWaves{{{2.3, 3.2}, {6.1, 2.6}, {15, 1}}};

// The azimuths of the tables of rays (CraterGlow).
struct Azimuths {
  static constexpr std::size_t kCount = CraterGlow::kAzimuths;
  std::array<double, kCount> cosine, sine;
  std::array<double, kCount> weight;                           // share of the circle: the trapezoidal rule
  std::array<std::array<double, kCount>, kWaves.size()> x, y;  // on the circles of kWaves

  Azimuths() {
    const auto azimuth = [](double i) {
      const double side = std::floor(4 * i / kCount), in_side = 4 * i / kCount - side;
      return side * pi / 2 + std::atan2(in_side, 1 - in_side);
    };
    for (std::size_t i = 0; i < kCount; ++i) {
      const auto at = static_cast<double>(i);
      cosine[i] = std::cos(azimuth(at));
      sine[i] = std::sin(azimuth(at));
      weight[i] = (azimuth(at + 1) - azimuth(at - 1)) / (4 * pi);
      for (std::size_t k = 0; k < kWaves.size(); ++k) {
        x[k][i] = kWaves[k].per_radius * cosine[i];
        y[k][i] = kWaves[k].per_radius * sine[i];
      }
    }
  }
  static const Azimuths& shared() {
    static const Azimuths azimuths;
    return azimuths;
  }
};

}  // namespace

// Rays of a crater: brightness by azimuth, with mean 1, near the crater and far from it; in between they are blended,
// so that rays are not straight.
class CraterBrightness::Rays {
 public:
  explicit Rays(std::uint64_t crater_id) {
    Draws draws(crater_id, 1, 0, 0);
    const auto seed = static_cast<std::uint32_t>(draws.bits());
    const double downrange = 2 * pi * draws.uniform(), to_x = 0.45 * std::cos(downrange),
                 to_y = 0.45 * std::sin(downrange);
    const Azimuths& azimuths = Azimuths::shared();
    for (std::size_t table = 0; table < value_.size(); ++table) {
      std::array<double, Azimuths::kCount> broken;
      broken.fill(1);
      const double height = 0.3 + 0.9 * static_cast<double>(table);  // each table cuts the noise elsewhere
      for (std::size_t k = 0; k < kWaves.size(); ++k)
        add_noise({azimuths.x[k].data(), azimuths.y[k].data(), height, broken.size()},
                  seed + static_cast<std::uint32_t>(k), kWaves[k].amplitude, broken.data());
      double mean = 0;
      for (std::size_t i = 0; i < broken.size(); ++i) {
        broken[i] = std::clamp(broken[i], 0.0, 3.0) * (1 + to_x * azimuths.cosine[i] + to_y * azimuths.sine[i]);
        mean += azimuths.weight[i] * broken[i];
      }
      for (std::size_t i = 0; i < broken.size(); ++i) value_[table][i] = static_cast<float>(broken[i] / mean);
      value_[table].back() = value_[table].front();
    }
  }

  const float* near() const { return value_[0].data(); }
  const float* far() const { return value_[1].data(); }
  static constexpr double kFar = 5;  // crater radii from the centre to `far`

 private:
  std::array<std::array<float, Azimuths::kCount + 1>, 2> value_{};
};

// The latest rays: adjacent blocks share those of large craters.
class CraterBrightness::RaysCache {
 public:
  // The reference is valid until the next call.
  const Rays& of(std::uint64_t crater_id) {
    std::unique_ptr<Entry>& entry = entries_[crater_id % entries_.size()];
    if (!entry || entry->crater_id != crater_id) entry.reset(new Entry{crater_id, Rays(crater_id)});
    return entry->rays;
  }

 private:
  struct Entry {
    std::uint64_t crater_id;
    Rays rays;
  };
  std::array<std::unique_ptr<Entry>, 128> entries_;  // some 260 KB
};

namespace {

// Returns the share of immature soil in what a crater digs up, from a tenth of its diameter.
double immature_share(double diameter_m) {
  constexpr double kMatureDepth_m = 0.3;
  const double t = std::clamp(0.5 + 0.5 * std::log10(0.1 * diameter_m / kMatureDepth_m), 0.0, 1.0);
  return 0.2 + 0.8 * t * t * (3 - 2 * t);
}

}  // namespace

CraterBrightness::CraterBrightness(const CraterField& craters, double variation)
    : variation_(variation), smallest_octave_(craters.smallest_octave()) {
  if (none()) return;
  means_.resize(static_cast<std::size_t>(std::max(0, craters.largest_octave() - smallest_octave_ + 1)));
  in_parallel(means_.size(), [&](std::size_t i) {
    const int octave = smallest_octave_ + static_cast<int>(i);
    means_[i] = mean_of_sizes(craters.ages(), std::max(std::ldexp(1.0, octave), craters.law().smallest_m),
                              craters.largest_m(octave));
  });
}

// Integrates what craters add over diameters, ages and places: the number of craters per m^2 times the integral over
// the ground of one of them.
double CraterBrightness::mean_of_sizes(const CraterAges& ages, double smallest_m, double largest_m) const {
  constexpr int kSizes = 8, kAges = 128, kPlaces = 8;
  double sum = 0;
  for (int i = 0; i < kSizes; ++i) {
    const double low_m = smallest_m * std::pow(largest_m / smallest_m, static_cast<double>(i) / kSizes),
                 high_m = smallest_m * std::pow(largest_m / smallest_m, (i + 1.0) / kSizes),
                 diameter_m = std::sqrt(low_m * high_m);
    const double oldest = ages.life(diameter_m).oldest;
    double mean_area = 0;  // of what one crater adds, squared radii
    for (int age = 0; age < kAges; ++age) {
      // Young craters add most: the midpoints are denser there.
      const double u = (age + 0.5) / kAges, share = u * u;
      const double age_Ma = age_Ma_of(share * oldest);
      for (int p = 0; p < kPlaces; ++p) {
        const Zones zones = zones_of(diameter_m, age_Ma, local_factor_of((p + 0.5) / kPlaces));
        if (zones.none()) continue;
        const Profile& profile = profile_of(zones.reach);
        mean_area += 2 * u * (zones.bright * profile.area_bright - zones.dim * profile.area_dim) / (kAges * kPlaces);
      }
    }
    mean_area += mean_wall(ages, diameter_m) * profile_of(0).area_wall;
    sum += ages.number_per_m2(low_m, high_m) * mean_area * diameter_m * diameter_m / 4;
  }
  return sum;
}

double CraterBrightness::wall_of(double scale_over_diameter, double age) const {
  constexpr double kLevel_deg = 18, kSteep_deg = 30;
  const double slope_deg = std::atan(scale_over_diameter * steepest_wall(age)) * kDegreesPerRadian;
  return variation_ * kSteepWall * smoothstep((slope_deg - kLevel_deg) / (kSteep_deg - kLevel_deg));
}

// Integrates over the deviates from which CraterField draws depths and ages.
double CraterBrightness::mean_wall(const CraterAges& ages, double diameter_m) const {
  constexpr int kDepths = 31, kAges = 64;
  constexpr double kWidest = 3;  // standard deviations
  const CraterAges::Life life = ages.life(diameter_m);
  double sum = 0, weights = 0;
  for (int i = 0; i < kDepths; ++i) {
    const double deviate = kWidest * (2.0 * i / (kDepths - 1) - 1), weight = std::exp(-deviate * deviate / 2);
    const double ratio = fresh_ratio(diameter_m, deviate);
    const double oldest = life.oldest / life.worn_out * CraterShape::of_all().age_of(kVisible / ratio);
    weights += weight;
    for (int age = 0; age < kAges; ++age) {
      // Young craters are the steepest: the midpoints are denser there.
      const double u = (age + 0.5) / kAges;
      sum += weight * 2 * u / kAges * wall_of(ratio / CraterShape::kFreshDepth, u * u * oldest);
    }
  }
  return sum / weights;
}

CraterBrightness::Zones CraterBrightness::zones_of(double diameter_m, double age_Ma, double local_factor) const {
  constexpr double kFadingAt10m_Ma = 6, kFadingExponent = 1.05;
  constexpr double kSlowShare = 0.15, kSlowTimes = 5, kDimTimes = 0.3;  // of the fading time
  const double fading_Ma = kFadingAt10m_Ma * std::pow(diameter_m / 10, kFadingExponent);
  const double fresh = variation_ * kNewRim * local_factor * immature_share(diameter_m);
  const double bright = fresh * ((1 - kSlowShare) * std::exp(-age_Ma / fading_Ma) +
                                 kSlowShare * std::exp(-age_Ma / (kSlowTimes * fading_Ma)));
  if (bright < kFaintest) return {};
  return {bright, kDimmest * fresh * std::exp(-age_Ma / (kDimTimes * fading_Ma)), 0,
          bright > 0.1    ? 2
          : bright > 0.03 ? 1
                          : 0};
}

CraterBrightness::Zones CraterBrightness::zones_of(const Crater& crater) const {
  Zones zones = zones_of(crater.diameter_m, crater.age_Ma, local_factor_of(Draws(crater.id, 0, 0, 0).uniform()));
  zones.wall = wall_of(crater.scale / crater.diameter_m, crater.age);
  return zones;
}

double CraterBrightness::Zones::reach_radii() const {
  // Walls alone end at the rim, which is farther out in some directions.
  constexpr double kWallRadii = 1.06 / (1 - CraterOutline::kMaxWave);
  return bright == 0 ? kWallRadii : profile_of(reach).reach;
}

double CraterBrightness::at_rim(const Crater& crater) const {
  const Zones zones = zones_of(crater);
  if (zones.none()) return 0;
  const Profile& profile = profile_of(zones.reach);
  const auto rim = static_cast<std::size_t>(Profile::kSteps);
  return zones.bright * static_cast<double>(profile.bright[rim]) - zones.dim * static_cast<double>(profile.dim[rim]) +
         zones.wall * static_cast<double>(profile.wall[rim]);
}

void CraterBrightness::add_crater(const Crater& crater, const Zones& zones, const DirectionGrid& grid, RaysCache& cache,
                                  std::span<float> added) {
  const Profile& profile = profile_of(zones.reach);
  const double reach = zones.reach_radii();
  const auto bright = static_cast<float>(zones.bright), dim = static_cast<float>(zones.dim),
             wall = static_cast<float>(zones.wall);
  // Tables in the steps of the profile, which ends in zeros.
  std::array<float, static_cast<std::size_t>(kWidestReach * Profile::kSteps) + 3> even{}, in_rays{};
  const auto steps = static_cast<std::size_t>(reach * Profile::kSteps) + 2;
  for (std::size_t i = 0; i < steps; ++i) {
    even[i] = bright * profile.bright[i] - dim * profile.dim[i] + wall * profile.wall[i];
    in_rays[i] = bright * profile.bright[i] * profile.in_rays[i];
  }
  CraterGlow glow{even.data(), nullptr, nullptr, nullptr, Profile::kSteps, 0};
  if (zones.reach > 0) {
    const Rays& rays = cache.of(crater.id);
    glow.in_rays = in_rays.data();
    glow.near_rays = rays.near();
    glow.far_rays = rays.far();
    glow.far_per_step = static_cast<float>(1 / ((Rays::kFar - 1) * Profile::kSteps));
  }
  visit_rows_under(crater, reach, Profile::kSteps, grid,
                   [&](const CraterOverRow& over_row, const RowUnderCrater& row, std::size_t first_post) {
                     brighten_around_crater(over_row, row, glow, added.data() + first_post);
                   });
}

void CraterBrightness::add(const CraterField& craters, const DirectionGrid& grid, int octave,
                           std::span<const double> shares, std::span<double> factor, const StopToken& stop,
                           double weight) const {
  const BoundingBall ball = ball_around(grid);
  std::vector<Crater> near;
  craters.within(octave, ball.direction, ball.radius_m + kWidestReach * craters.largest_m(octave) / 2, near, stop);
  const auto misses = [&](const Crater& crater, double reach_radii) {
    return (crater.centre - ball.direction).norm() * kMoonRadius_m >
           ball.radius_m + reach_radii * crater.diameter_m / 2;
  };
  std::vector<std::pair<Crater, Zones>> bright;
  for (const Crater& crater : near) {
    if (misses(crater, kWidestReach)) continue;
    const Zones zones = zones_of(crater);
    if (!zones.none() && !misses(crater, zones.reach_radii())) bright.emplace_back(crater, zones);
  }
  // Sums are rounded: one order for all grids.
  std::sort(bright.begin(), bright.end(), [](const auto& a, const auto& b) { return formed_before(a.first, b.first); });
  std::vector<float> added(factor.size(), 0.F);
  static Pool<RaysCache> caches;
  const Pool<RaysCache>::Lease cache(caches);
  for (const auto& [crater, zones] : bright) {
    stop.check();
    add_crater(crater, zones, grid, *cache, added);
  }
  const double octave_mean = mean(octave);
  for (std::size_t i = 0; i < factor.size(); ++i)
    factor[i] += weight * (static_cast<double>(added[i]) - (shares.empty() ? octave_mean : shares[i] * octave_mean));
}

}  // namespace selenograph::dem
