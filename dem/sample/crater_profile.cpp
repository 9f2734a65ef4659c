#include "dem/sample/crater_profile.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "dem/base/noise.h"
#include "dem/base/smoothstep.h"

namespace selenograph::dem::sample {
namespace {

constexpr double kPi = std::numbers::pi;

// Factor on the profile's reach: where the irregular outline is wider than the circle, the profile reaches farther out.
constexpr double kOutlineMargin = 1.15;
constexpr double kSimpleReach = 3.0, kComplexReach = 5.0;
// Smallest diffusion age: slumping rounds a crest at once.
constexpr double kFreshDegradation = 4e-4;
// Diameter from which craters are complex: the intersection of Pike's two depth laws.
constexpr double kComplexFrom_km = 10.6;
// Diameter from which craters get lobate ejecta and rugged walls. On smaller craters these would be below a few posts.
constexpr double kTexturedFrom_m = 3000;

double to_km(double m) { return m * 1e-3; }

}  // namespace

std::uint64_t SplitMix::next() { return split_mix(state_ += kSplitMixStep); }

double SplitMix::uniform() { return static_cast<double>(next() >> 11) * 0x1p-53; }

int SplitMix::poisson(double mean) {
  const double limit = std::exp(-mean);
  double product = uniform();
  int count = 0;
  while (product > limit) {
    product *= uniform();
    ++count;
  }
  return count;
}

std::uint64_t mix(std::uint64_t a, std::uint64_t b) { return SplitMix(a * 0xD1342543DE82EF95u + b).next(); }

double smoothstep(double from, double to, double x) { return dem::smoothstep((x - from) / (to - from)); }

// ---- noise ----------------------------------------------------------------------------------------------------------

double gradient_noise(double x, double y, double z, std::uint64_t seed) {
  return perlin_noise<double>(x, y, z, static_cast<std::uint32_t>(seed ^ (seed >> 32)));
}

// ---- dimensions -----------------------------------------------------------------------------------------------------

// Power laws of simple and complex craters (kilometres): Pike 1977, "Size-dependence in the shape of fresh impact
// craters on the Moon".
double crater_depth_m(double diameter_m) {
  const double d = to_km(diameter_m);
  return 1e3 * std::min(0.196 * std::pow(d, 1.010), 1.044 * std::pow(d, 0.301));
}

double crater_rim_height_m(double diameter_m) {
  const double d = to_km(diameter_m);
  return 1e3 * std::min(0.036 * std::pow(d, 1.014), 0.236 * std::pow(d, 0.399));
}

// Uses h = 0.0006 D^1.97 from about 20 km: Hale & Grieve 1982, "Volumetric analysis of complex lunar craters".
double central_peak_height_m(double diameter_m) {
  return diameter_m < 20000 ? 0 : 1e3 * 0.0006 * std::pow(to_km(diameter_m), 1.97);
}

// ---- population -----------------------------------------------------------------------------------------------------

namespace {

// Crater production is D^-2 for large craters and steepens to D^-3 below kSteepBelow_km (Melosh 1989, ch. 10). Where it
// would exceed the equilibrium density, new craters erase as many as they add: 8 % of geometric saturation, 1.54 D^-2
// (Gault 1970).
constexpr double kSteepBelow_km = 1.5;
constexpr double kEquilibrium = 0.12;
constexpr double kHighlandProduction = 0.12, kMareProduction = 0.006;

// Returns the cumulative number of craters per km^2 above a diameter.
double density(double production, double diameter_km) {
  return std::min(production * std::max(1.0, kSteepBelow_km / diameter_km), kEquilibrium) / (diameter_km * diameter_km);
}

// Returns kappa t / R^2 of a crater as old as the maria. Fassett & Thomson 2014 find kappa t near 17 000 m2 after 3.5
// Gyr at 1 km. Larger craters are worn by larger impacts, hence kappa grows with size (Xie et al. 2017, "anomalous
// diffusion").
double degradation_since_maria(double diameter_km) {
  const double kappa_t_m2 = 17000 * std::pow(diameter_km, 0.9);
  const double radius_m = 500 * diameter_km;
  return kappa_t_m2 / (radius_m * radius_m);
}

// Sets a crater's age and degradation from a uniform random number `u`.
void draw_age(Crater& crater, bool before_maria, double u) {
  const double since_maria = degradation_since_maria(to_km(crater.diameter_m));
  if (!before_maria) {
    // Limit the age: in equilibrium an older crater has been erased already.
    crater.age = u * std::min(1.0, kErasedDegradation / since_maria);
    crater.degradation = crater.age * since_maria;
    return;
  }
  // Degrade the oldest far more: the early bombardment wore them down more than the billions of years since.
  const double oldest = std::min(kErasedDegradation, 20 * since_maria + 0.03);
  crater.age = 1 + u;
  crater.degradation = std::lerp(std::min(since_maria, oldest), oldest, u);
}

// Grid of latitude bands of equal height, each divided into nearly square cells.
struct CellGrid {
  int bands;
  double height_deg;
  explicit CellGrid(double cell_m)
      : bands(std::max(6, static_cast<int>(std::lround(kPi * kMoonRadius_m / cell_m)))), height_deg(180.0 / bands) {}
  double south_deg(int band) const { return -90 + band * height_deg; }
  int columns(int band) const {
    const double middle = south_deg(band) + height_deg / 2;
    return std::max(1, static_cast<int>(std::lround(360 / height_deg * std::cos(middle * kRadiansPerDegree))));
  }
};

struct Cell {
  double south_deg, north_deg, west_deg, east_deg;
  double area_km2() const {
    const double r = to_km(kMoonRadius_m);
    return r * r * (east_deg - west_deg) * kRadiansPerDegree *
           (std::sin(north_deg * kRadiansPerDegree) - std::sin(south_deg * kRadiansPerDegree));
  }
};

// Diameters of one octave: number 0 ends at the largest crater, each further one is half as large.
struct OctaveOfSizes {
  int octave;
  double low_km, high_km;
  explicit OctaveOfSizes(int o) : octave(o), low_km(to_km(kLargestCrater_m) * std::exp2(-o - 1)), high_km(2 * low_km) {}
};

using Density = double (*)(double);

double density_before_maria(double d_km) { return highland_density_per_km2(d_km) - mare_density_per_km2(d_km); }

// Draws the craters of one octave in one cell: a Poisson number, with uniform positions. Draws those that are too
// small, too, so that the random sequence does not depend on `min_diameter_m`.
void draw_cell(const OctaveOfSizes& sizes, const Cell& cell, bool before_maria, std::uint64_t seed,
               double min_diameter_m, std::vector<Crater>& craters) {
  const Density density_of = before_maria ? density_before_maria : mare_density_per_km2;
  const double low = density_of(sizes.low_km), high = density_of(sizes.high_km);
  if (low <= high) return;
  SplitMix random(seed);
  const int count = random.poisson((low - high) * cell.area_km2());
  // Interpolate the distribution within the octave by a power law through both ends.
  const double slope = high > 0 ? std::log2(low / high) : 2.0;
  for (int i = 0; i < count; ++i) {
    Crater c;
    c.octave = sizes.octave;
    const double u = random.uniform(std::exp2(-slope), 1.0);
    c.diameter_m = 1e3 * sizes.low_km * std::pow(u, -1 / slope);
    const double z =
        random.uniform(std::sin(cell.south_deg * kRadiansPerDegree), std::sin(cell.north_deg * kRadiansPerDegree));
    c.lat_deg = std::asin(std::clamp(z, -1.0, 1.0)) / kRadiansPerDegree;
    c.lon_deg = wrap_lon_deg(random.uniform(cell.west_deg, cell.east_deg));
    c.center = to_cartesian({c.lat_deg, c.lon_deg, 0}) / kMoonRadius_m;
    draw_age(c, before_maria, random.uniform());
    c.id = random.next();
    if (c.diameter_m >= min_diameter_m) craters.push_back(c);
  }
}

// Returns the half-width in longitude of a cap around a point at this latitude; 180 when it contains the pole.
double cap_half_width_deg(double lat_deg, double radius_deg) {
  if (std::abs(lat_deg) + radius_deg >= 90) return 180;
  return std::asin(std::sin(radius_deg * kRadiansPerDegree) / std::cos(lat_deg * kRadiansPerDegree)) /
         kRadiansPerDegree;
}

// Returns true if a crater's ejecta may reach into the box.
bool reaches(const Crater& crater, const GeographicBox& box) {
  const double reach_deg =
      crater_reach_radii(crater.diameter_m) * crater.diameter_m / 2 / kMoonRadius_m / kRadiansPerDegree;
  if (crater.lat_deg < box.south_deg - reach_deg || crater.lat_deg > box.north_deg + reach_deg) return false;
  const double half = (box.east_deg - box.west_deg) / 2;
  const double away = std::abs(wrap_lon_deg(crater.lon_deg - (box.west_deg + half)));
  return away <= half + cap_half_width_deg(crater.lat_deg, reach_deg);
}

// Draws the craters of one octave in all cells from which they may reach into the box.
void draw_octave(int octave, const GeographicBox& box, std::uint64_t seed, double min_diameter_m,
                 std::vector<Crater>& craters) {
  const OctaveOfSizes sizes(octave);
  const CellGrid grid(8e3 * sizes.high_km);
  const double reach_deg =
      crater_reach_radii(1e3 * sizes.high_km) * 500 * sizes.high_km / kMoonRadius_m / kRadiansPerDegree;
  const double margin_deg = cap_half_width_deg(std::max(std::abs(box.south_deg), std::abs(box.north_deg)), reach_deg);
  const auto band_of = [&](double lat) {
    return std::clamp(static_cast<int>(std::floor((lat + 90) / grid.height_deg)), 0, grid.bands - 1);
  };
  for (int band = band_of(box.south_deg - reach_deg); band <= band_of(box.north_deg + reach_deg); ++band) {
    const int columns = grid.columns(band);
    const double width = 360.0 / columns;
    const int first = static_cast<int>(std::floor((box.west_deg - margin_deg) / width));
    const int last = static_cast<int>(std::floor((box.east_deg + margin_deg) / width));
    for (int i = first; i <= std::min(last, first + columns - 1); ++i) {
      const int column = ((i % columns) + columns) % columns;
      const double south = grid.south_deg(band);
      const Cell cell{south, south + grid.height_deg, column * width, (column + 1) * width};
      const auto cell_seed = mix(mix(mix(seed, static_cast<std::uint64_t>(octave)), static_cast<std::uint64_t>(band)),
                                 static_cast<std::uint64_t>(column));
      for (const bool before_maria : {true, false}) {
        draw_cell(sizes, cell, before_maria, mix(cell_seed, before_maria), min_diameter_m, craters);
      }
    }
  }
}

}  // namespace

double highland_density_per_km2(double diameter_km) { return density(kHighlandProduction, diameter_km); }
double mare_density_per_km2(double diameter_km) { return density(kMareProduction, diameter_km); }

double crater_reach_radii(double diameter_m) {
  return kOutlineMargin * (to_km(diameter_m) < kComplexFrom_km ? kSimpleReach : kComplexReach);
}

std::vector<Crater> craters_reaching(const GeographicBox& box, std::uint64_t seed, double min_diameter_m) {
  std::vector<Crater> craters;
  for (int octave = 0; kLargestCrater_m * std::exp2(-octave) > min_diameter_m; ++octave) {
    draw_octave(octave, box, seed, min_diameter_m, craters);
  }
  std::erase_if(craters, [&](const Crater& c) { return !reaches(c, box); });
  std::sort(craters.begin(), craters.end(),
            [](const Crater& a, const Crater& b) { return a.age != b.age ? a.age > b.age : a.id < b.id; });
  return craters;
}

// ---- radial profile -------------------------------------------------------------------------------------------------

namespace {

constexpr int kCells = 1024;  // intervals of a profile's table

// The functions below take x, the distance from the centre over the crater's radius; depth, rim height and results are
// in radii, too.

// Returns the height of ejecta, which thin out as (r/R)^-3 (McGetchin et al. 1973), brought to zero at the profile's
// reach.
double ejecta(double x, double rim, double reach) {
  return rim / (x * x * x) * (1 - smoothstep(0.55 * reach, reach, x));
}

// Returns the height of a simple bowl: a hyperbola with a rounded floor and straight walls of at most 31 degrees, the
// angle of repose. A paraboloid of the same depth would have 39 degrees below its rim.
double simple_bowl(double x, double depth, double rim) {
  constexpr double kWallSlope = 0.60;
  const double a = (kWallSlope * kWallSlope - depth * depth) / (2 * depth);
  return rim - depth + std::hypot(a, kWallSlope * x) - a;
}

// Returns the height of a complex bowl: a flat floor of diameter 0.187 D^1.249 km (Pike 1977), then a wall stepped by
// terraces, steepest below the rim.
double complex_bowl(double x, double depth, double rim, double diameter_km) {
  const double floor_edge = std::clamp(0.187 * std::pow(diameter_km, 0.249), 0.25, 0.7);
  const double t = (x - floor_edge) / (1 - floor_edge);
  if (t <= 0) return rim - depth - 0.01 * depth * (1 - x * x / (floor_edge * floor_edge));
  // Fade out the terraces of the smallest complex craters, whose walls are near the angle of repose already.
  const double terracing = smoothstep(11, 28, diameter_km);
  constexpr double kTerraces = 3;
  const double stepped = t - 0.55 * terracing / (2 * kPi * kTerraces) * std::sin(2 * kPi * kTerraces * t);
  return rim - depth + depth * std::lerp(stepped, stepped * stepped, 0.25 * terracing);
}

// Diffuses a profile, heights `dx` apart from the centre on, by the given kappa t / R^2: implicit axisymmetric steps of
// dh/dt = 1/x d/dx (x dh/dx) (Fassett & Thomson 2014), each a tridiagonal system solved by the Thomas algorithm.
void diffuse(std::vector<double>& h, double dx, double amount) {
  const int n = static_cast<int>(h.size()) - 1;
  std::vector<double> upper(h.size());
  double done = 0;
  while (done < amount) {
    const double dt = std::min(amount - done, std::max(2e-5, 0.25 * done));
    const double k = dt / (dx * dx);
    // Use the Laplacian 2 d2h/dx2 at the centre; the far end stays at zero.
    upper[0] = -4 * k / (1 + 4 * k);
    h[0] /= 1 + 4 * k;
    for (int i = 1; i < n; ++i) {
      const double below = -k * (1 - 0.5 / i), above = -k * (1 + 0.5 / i);
      const double pivot = 1 + 2 * k - below * upper[i - 1];
      upper[i] = above / pivot;
      h[i] = (h[i] - below * h[i - 1]) / pivot;
    }
    h[n] = 0;
    for (int i = n - 1; i >= 0; --i) h[i] -= upper[i] * h[i + 1];
    done += dt;
  }
}

}  // namespace

RadialProfile::RadialProfile(std::vector<double> heights, double reach, double degradation)
    : reach_(reach), cells_per_radius_(kCells / reach) {
  diffuse(heights, reach / kCells, std::max(degradation, kFreshDegradation));
  heights_.assign(heights.begin(), heights.end());
}

double RadialProfile::height(double distance) const {
  const double cell = distance * cells_per_radius_;
  if (cell >= kCells) return 0;
  const auto i = static_cast<std::size_t>(cell);
  return blend(static_cast<double>(heights_[i]), static_cast<double>(heights_[i + 1]), cell - static_cast<double>(i));
}

// Returns the precomputed profile of a simple crater whose degradation is nearest.
std::shared_ptr<const RadialProfile> RadialProfile::simple(double degradation) {
  // Number of precomputed states of degradation. Eight states per doubling are finer than the eye can see; craters
  // between two states use the nearer.
  constexpr int kStates = 81, kPerDoubling = 8;
  static const auto states = [] {
    std::vector<double> fresh(kCells + 1);
    // Use the depth of a 1 km crater, 0.196 D = 0.392 R: simple craters are similar.
    const double depth = 2e-3 * crater_depth_m(1000), rim = 2e-3 * crater_rim_height_m(1000);
    for (int i = 0; i <= kCells; ++i) {
      const double x = i * kSimpleReach / kCells;
      fresh[static_cast<std::size_t>(i)] = x < 1 ? simple_bowl(x, depth, rim) : ejecta(x, rim, kSimpleReach);
    }
    std::array<std::shared_ptr<const RadialProfile>, kStates> profiles;
    for (int s = 0; s < kStates; ++s) {
      const double state = kFreshDegradation * std::exp2(static_cast<double>(s) / kPerDoubling);
      profiles[static_cast<std::size_t>(s)].reset(new RadialProfile(fresh, kSimpleReach, state));
    }
    return profiles;
  }();
  const double doublings = std::log2(std::max(degradation, kFreshDegradation) / kFreshDegradation);
  const long nearest = std::lround(doublings * kPerDoubling);
  return states[static_cast<std::size_t>(std::min<long>(nearest, kStates - 1))];
}

std::shared_ptr<const RadialProfile> RadialProfile::complex(double diameter_m, double degradation) {
  std::vector<double> fresh(kCells + 1);
  const double depth = 2 * crater_depth_m(diameter_m) / diameter_m;
  const double rim = 2 * crater_rim_height_m(diameter_m) / diameter_m;
  // Fill the floor and lower the rim: large craters lose depth to later ejecta, which leave a wide flat floor, and rim
  // height to impacts on the crest, more than by diffusion.
  const double worn = smoothstep(0, 0.08, degradation);
  const double floor = rim - depth * (1 - 0.6 * worn), rim_left = 1 - 0.5 * worn;
  for (int i = 0; i <= kCells; ++i) {
    const double x = i * kComplexReach / kCells;
    double h = x < 1 ? complex_bowl(x, depth, rim, to_km(diameter_m)) : ejecta(x, rim, kComplexReach);
    if (worn > 0 && x < 1) h = std::max(h, floor - 0.02 * depth * (1 - x * x));
    fresh[static_cast<std::size_t>(i)] = h > 0 ? h * rim_left : h;
  }
  return std::shared_ptr<const RadialProfile>(new RadialProfile(std::move(fresh), kComplexReach, 0.2 * degradation));
}

// ---- shape ----------------------------------------------------------------------------------------------------------

CraterShape::CraterShape(const Crater& crater)
    : diameter_m_(crater.diameter_m),
      radius_m_(crater.diameter_m / 2),
      reach_m_(crater_reach_radii(crater.diameter_m) * radius_m_),
      // small relief fades faster than the bowl
      peak_share_(std::exp(-crater.degradation / 0.04)),
      texture_m_(crater_rim_height_m(crater.diameter_m) * std::exp(-crater.degradation / 0.008)),
      noise_seed_(mix(crater.id, 3)),
      complex_(to_km(crater.diameter_m) >= kComplexFrom_km),
      textured_(crater.diameter_m >= kTexturedFrom_m && crater.degradation < 0.04),
      profile_(complex_ ? RadialProfile::complex(crater.diameter_m, crater.degradation)
                        : RadialProfile::simple(crater.degradation)) {
  draw_outline(crater.id, crater.diameter_m >= kTexturedFrom_m ? kMaxHarmonics : 3);
  draw_peaks(crater);
}

void CraterShape::draw_outline(std::uint64_t id, int harmonics) {
  SplitMix random(mix(id, 1));
  harmonics_ = harmonics;
  // Start at the second harmonic (an ellipse): the first would only move the centre.
  for (int k = 2; k <= harmonics; ++k) {
    const double amplitude = 0.06 * std::pow(k, -1.2) * random.uniform(0.3, 1.0), phase = random.uniform(0, 2 * kPi);
    cosine_[k] = amplitude * std::cos(phase);
    sine_[k] = amplitude * std::sin(phase);
  }
}

// Draws the central peak as a cluster of unequal summits.
void CraterShape::draw_peaks(const Crater& crater) {
  const double height = central_peak_height_m(crater.diameter_m) * peak_share_;
  if (height <= 0) return;
  SplitMix random(mix(crater.id, 2));
  peaks_.push_back({0, 0, height, 0.075 * diameter_m_});
  const int minor_peaks = 2 + static_cast<int>(random.uniform(0, 4));
  for (int i = 0; i < minor_peaks; ++i) {
    const double angle = random.uniform(0, 2 * kPi), distance_m = random.uniform(0.03, 0.085) * diameter_m_;
    const double share = random.uniform(0.25, 0.75);
    peaks_.push_back({distance_m * std::cos(angle), distance_m * std::sin(angle), share * height,
                      (0.03 + 0.04 * share) * diameter_m_});
  }
}

// Returns the factor of the outline's radius in a direction. Fine scallops are limited to the crest: down the wall and
// out into the ejecta they would look like spokes.
double CraterShape::outline(double x, double cosine, double sine) const {
  constexpr int kOvalHarmonics = 4;
  const bool at_crest = x > 0.6 && x < 1.7;
  // c and s: cosine and sine of k times the azimuth, by the addition theorem.
  double c = cosine, s = sine, oval = 0, scallops = 0;
  for (int k = 2; k <= (at_crest ? harmonics_ : std::min(harmonics_, kOvalHarmonics)); ++k) {
    const double next_c = c * cosine - s * sine;
    s = s * cosine + c * sine;
    c = next_c;
    (k <= kOvalHarmonics ? oval : scallops) += cosine_[k] * c + sine_[k] * s;
  }
  if (at_crest) scallops *= smoothstep(0.6, 0.95, x) * (1 - smoothstep(1.05, 1.7, x));
  return 1 + oval + scallops;
}

// Returns the height of the central peaks. Summits merge by a power mean near their maximum: their sum would be one
// smooth dome, and their maximum has creases.
double CraterShape::peaks_m(double east_m, double north_m) const {
  double fourth_powers = 0;  // sum over the peaks
  for (const Peak& p : peaks_) {
    const double d = std::hypot(east_m - p.east_m, north_m - p.north_m) / p.radius_m;
    if (d >= 1.6) continue;
    const double cone = p.height_m * (1.25 - std::hypot(0.25, d)) * (1 - smoothstep(0.9, 1.6, d));
    fourth_powers += std::pow(std::max(cone, 0.0), 4);
  }
  if (fourth_powers <= 0) return 0;
  const double f = 18 / diameter_m_;
  const double rough = gradient_noise(east_m * f, north_m * f, 0.5, noise_seed_) +
                       0.5 * gradient_noise(2.3 * east_m * f, 2.3 * north_m * f, 0.5, noise_seed_);
  return std::pow(fourth_powers, 0.25) * (1 + 0.35 * rough);
}

// Returns the height of texture: hummocky ejecta that become lobate outwards, slumps on the wall, a rumpled floor.
// Noise in the plane is mixed with a little noise by azimuth; azimuth alone would draw a daisy.
double CraterShape::texture_m(double x, double cosine, double sine) const {
  const double outside = smoothstep(0.9, 1.2, x) * (1 - smoothstep(1.9, 2.9, x)) / std::max(1.0, x * x);
  const double wall = smoothstep(0.3, 0.55, x) * (1 - smoothstep(0.9, 1.1, x));
  const double floor = complex_ ? 1 - smoothstep(0.3, 0.6, x) : 0;
  double lobes = 0, hummocks = 0;
  if (outside > 0) {
    lobes = gradient_noise(4.5 * cosine, 4.5 * sine, 2.2 * x, noise_seed_ + 3) +
            0.4 * gradient_noise(11 * cosine, 11 * sine, 4 * x, noise_seed_ + 4);
  }
  if (outside + wall + floor > 0) {
    const double u = x * cosine, v = x * sine;
    hummocks = gradient_noise(5 * u, 5 * v, 0.37, noise_seed_) +
               0.45 * gradient_noise(11 * u, 11 * v, 0.37, noise_seed_ + 1) +
               0.18 * gradient_noise(23 * u, 23 * v, 0.37, noise_seed_ + 2);
  }
  return texture_m_ * (outside * (0.22 * lobes + 0.20 * hummocks) + (0.08 * wall + 0.05 * floor) * hummocks);
}

// Returns what a crater does to the ground at an offset from its centre: the height it adds, and the share of older
// relief that it leaves.
CraterShape::Trace CraterShape::trace(double east_m, double north_m) const {
  const double r = std::sqrt(east_m * east_m + north_m * north_m);
  const double cosine = r > 0 ? east_m / r : 1, sine = r > 0 ? north_m / r : 0;
  double x = r / radius_m_;  // distance in radii of the irregular outline
  x /= outline(x, cosine, sine);
  if (x >= profile_->reach()) return {};
  // Displace terraces and the foot of the wall by noise, so that they do not follow circles.
  if (complex_ && x > 0.2 && x < 1.0) {
    const double u = east_m / radius_m_, v = north_m / radius_m_;
    const double wander = gradient_noise(3.5 * u, 3.5 * v, 0.7, noise_seed_ + 5) +
                          0.5 * gradient_noise(8 * u, 8 * v, 0.7, noise_seed_ + 6);
    x += 0.075 * wander * smoothstep(0.2, 0.5, x) * (1 - smoothstep(0.85, 1.0, x));
  }
  Trace t;
  t.height_m = radius_m_ * profile_->height(x);
  if (textured_ && x < 2.9) t.height_m += texture_m(x, cosine, sine);
  if (!peaks_.empty() && x < 0.5) t.height_m += peaks_m(east_m, north_m);
  t.keep = 0.04 + 0.96 * smoothstep(0.95, 1.9, x);
  return t;
}

}  // namespace selenograph::dem::sample
