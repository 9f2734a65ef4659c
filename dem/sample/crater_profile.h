// Impact craters of the sample terrain: number, size, age and shape.
//
//        complex: terraced wall, flat floor, peak                 simple: bowl
//          __                              __                    __          __       rim crest, at 1 radius
//     _.--'  \_           __             _/  '--._          _.--'  \        /  '--._  ejecta, 0 at the reach
//              \_      __/  \__        _/                           \      /
//                \____/        \______/                              '-..-'           floor
//
// A population is a pure function of the seed: it is drawn per octave of diameter and per cell of the sphere. The
// craters at a position therefore do not depend on the requested extent or resolution. Units: metres, unit directions
// in MOON_ME, degrees in interfaces.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "dem/grid/geodesy.h"

// Independent of dem/detail, which has its own craters.
namespace selenograph::dem::sample {

// Random numbers that are the same on every machine, unlike the distributions of <random>. Steele et al. 2014,
// "SplitMix".
class SplitMix {
 public:
  explicit SplitMix(std::uint64_t seed) : state_(seed) {}
  std::uint64_t next();
  double uniform();  // [0, 1)
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  int poisson(double mean);  // for means up to a few hundred

 private:
  std::uint64_t state_;
};

// Hashes two numbers into a seed.
std::uint64_t mix(std::uint64_t a, std::uint64_t b);

// Returns gradient noise in three dimensions (Perlin 2002), about -1..1, of unit wavelength. Noise on a sphere is
// sampled in 3-D, without singularities at the date line or the poles.
double gradient_noise(double x, double y, double z, std::uint64_t seed);

// Returns 0 up to `from`, 1 beyond `to`, and a smooth cubic between them.
double smoothstep(double from, double to, double x);

// Dimensions of a fresh crater, m.
double crater_depth_m(double diameter_m);         // rim crest to floor
double crater_rim_height_m(double diameter_m);    // rim crest above the surroundings
double central_peak_height_m(double diameter_m);  // above the floor; 0: no peak

// Largest diameter. Octave 0 has diameters of 32..64 km, octave 1 of 16..32 km and so on.
inline constexpr double kLargestCrater_m = 64000.0;

struct Crater {
  double lat_deg = 0, lon_deg = 0;
  Vec3 center = Vec3::unit_z();
  double diameter_m = 0;
  int octave = 0;
  // Time of formation: 0 is today, 1 the flooding of the maria, 2 the oldest surface. Younger craters overlie older
  // ones.
  double age = 0;
  // Diffusion age kappa t / R^2 (Fassett & Thomson 2014): 0 is fresh, from kErasedDegradation on hardly any relief is
  // left.
  double degradation = 0;
  std::uint64_t id = 0;  // seed of the crater's irregularities
};

inline constexpr double kErasedDegradation = 0.4;

// Return the number of craters per km2 larger than diameter_km: on highlands (all that formed), and on maria (those
// since the flooding).
double highland_density_per_km2(double diameter_km);
double mare_density_per_km2(double diameter_km);

struct GeographicBox {
  double south_deg, north_deg, west_deg, east_deg;
};

// Returns every crater of at least min_diameter_m whose traces (ejecta) may reach into the box, oldest first.
std::vector<Crater> craters_reaching(const GeographicBox& box, std::uint64_t seed, double min_diameter_m);

// Radial profile: height by distance from the centre, both in crater radii, softened by diffusion.
class RadialProfile {
 public:
  // Returns the profile of a simple crater. All simple craters are geometrically similar, so profiles are shared by
  // degradation.
  static std::shared_ptr<const RadialProfile> simple(double degradation);
  static std::shared_ptr<const RadialProfile> complex(double diameter_m, double degradation);

  double height(double distance) const;  // distance and result in radii
  double reach() const { return reach_; }

 private:
  RadialProfile(std::vector<double> heights, double reach, double degradation);
  double reach_, cells_per_radius_;
  std::vector<float> heights_;
};

// Evaluates the relief of one crater, in metres east and north of its centre.
class CraterShape {
 public:
  explicit CraterShape(const Crater& crater);

  struct Trace {
    double height_m = 0;  // added to the existing height
    double keep = 1;      // share of older relief that survives this crater, 0 to 1: see Layers
  };
  Trace trace(double east_m, double north_m) const;
  double reach_m() const { return reach_m_; }

 private:
  static constexpr int kMaxHarmonics = 14;
  struct Peak {
    double east_m, north_m, height_m, radius_m;
  };
  double outline(double x, double cosine, double sine) const;
  double texture_m(double x, double cosine, double sine) const;
  double peaks_m(double east_m, double north_m) const;
  void draw_outline(std::uint64_t id, int harmonics);
  void draw_peaks(const Crater& crater);

  double diameter_m_, radius_m_, reach_m_, peak_share_, texture_m_;
  std::uint64_t noise_seed_;
  bool complex_, textured_;
  std::shared_ptr<const RadialProfile> profile_;
  std::vector<Peak> peaks_;
  int harmonics_ = 0;
  double cosine_[kMaxHarmonics + 1] = {}, sine_[kMaxHarmonics + 1] = {};
};

// Returns an upper bound of the reach of a crater's ejecta from its centre, in radii.
double crater_reach_radii(double diameter_m);

}  // namespace selenograph::dem::sample
