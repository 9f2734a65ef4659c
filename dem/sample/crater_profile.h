// Impact craters of the sample terrain: number, size, age and shape.
//
// A population is a pure function of the seed: it is drawn per octave of diameter and per cell of the sphere, so that
// the craters at a place do not depend on the extent or resolution requested. Metres, unit directions in MOON_ME,
// degrees in interfaces.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "dem/grid/geodesy.h"

// Independent of dem/detail, which has its own craters.
namespace selenograph::dem::sample {

// Reproducible on every machine, unlike the distributions of <random>. Steele et al. 2014, "SplitMix".
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

std::uint64_t mix(std::uint64_t a, std::uint64_t b);

// Gradient noise in three dimensions (Perlin 2002), about -1..1, of unit wavelength. Noise on a sphere is sampled in
// 3-D, without singularities at the date line or the poles.
double gradient_noise(double x, double y, double z, std::uint64_t seed);

double smoothstep(double from, double to, double x);

// Fresh crater dimensions, metres from metres.
double crater_depth_m(double diameter_m);         // rim crest to floor
double crater_rim_height_m(double diameter_m);    // rim crest above the surroundings
double central_peak_height_m(double diameter_m);  // above the floor; 0: no peak

// Octave 0 is 32..64 km, octave 1 16..32 km and so on.
inline constexpr double kLargestCrater_m = 64000.0;

struct Crater {
  double lat_deg = 0, lon_deg = 0;
  Vec3 center = Vec3::UnitZ();
  double diameter_m = 0;
  int octave = 0;
  // Time of formation: 0 is today, 1 the flooding of the maria, 2 the oldest surface. Younger craters overlie older
  // ones.
  double age = 0;
  // Diffusion age kappa t / R^2 (Fassett & Thomson 2014): 0 is fresh, at kErasedDegradation little is left.
  double degradation = 0;
  std::uint64_t id = 0;  // seeds its irregularities
};

inline constexpr double kErasedDegradation = 0.4;

// Craters per km2 larger than diameter_km, on highlands (everything that formed) and since the maria.
double highland_density_per_km2(double diameter_km);
double mare_density_per_km2(double diameter_km);

struct GeographicBox {
  double south_deg, north_deg, west_deg, east_deg;
};

// Every crater of at least min_diameter_m whose traces (ejecta) may reach into the box, oldest first.
std::vector<Crater> craters_reaching(const GeographicBox& box, std::uint64_t seed, double min_diameter_m);

// Height over distance from the centre, in units of the crater's radius, softened by diffusion.
class RadialProfile {
 public:
  // Shared by all simple craters: they are similar, so only the degradation matters.
  static std::shared_ptr<const RadialProfile> simple(double degradation);
  static std::shared_ptr<const RadialProfile> complex(double diameter_m, double degradation);

  double height(double distance) const;  // both in radii
  double reach() const { return reach_; }

 private:
  RadialProfile(std::vector<double> heights, double reach, double degradation);
  double reach_, cells_per_radius_;
  std::vector<float> heights_;
};

// One crater ready to be evaluated, in metres east and north of its centre.
class CraterShape {
 public:
  explicit CraterShape(const Crater& crater);

  struct Trace {
    double height_m = 0;  // added to the existing height
    double keep = 1;      // share of older relief that survives: see Layers
  };
  Trace trace(double east_m, double north_m) const;
  double reach_m() const { return reach_m_; }

 private:
  static constexpr int kMostHarmonics = 14;
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
  double cosine_[kMostHarmonics + 1] = {}, sine_[kMostHarmonics + 1] = {};
};

// Upper bound on the reach of a crater's ejecta from its centre, in radii.
double crater_reach_radii(double diameter_m);

}  // namespace selenograph::dem::sample
