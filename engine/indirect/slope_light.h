// Sunlight that terrain reflects onto terrain: what arrives at a place from all ground that it sees. With two bounces
// that ground also reflects the light of the first.
//
// From each place, marches along azimuths (march.h) find the ground that is seen and its elevation. The
// integrals over elevation are exact for ground of one radiance per step; azimuths are sampled. No random numbers, no
// noise.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "dem/base/once.h"
#include "dem/base/stop_token.h"
#include "engine/frame/sun.h"
#include "engine/indirect/relief.h"
#include "engine/radiometry/brdf.h"

namespace selenograph::engine {

inline constexpr int kSectors = 8;
// Of a post. Those of the next row are halfway between them: what is interpolated has met twice as many. At a low Sun,
// what is lit is thin strips, which more azimuths are needed to meet.
inline constexpr int kAzimuths = 32, kAzimuthsAtLowSun = 64;
inline constexpr double kLowSun_deg = 10;
// For the light of ground that is seen: far more places of it are averaged.
inline constexpr int kAzimuthsOfGround = 32;

// Light arriving at a point from the ground in each of eight sectors of azimuth: the integral of radiance times the
// unit vector to where it comes from, W m-2, MOON_ME. Its dot product with a normal is the irradiance.
struct SectorLight {
  std::array<Eigen::Vector3f, kSectors> from;
  // Integral of the unit vector over the sky: a plane with normal n sees n . sky / pi of its hemisphere as sky.
  Eigen::Vector3f sky;
};

// The ground's albedo at unit directions, averaged over that many metres: factors of what the Brdf reflects or, for
// Hapke's model, w.
using GroundAlbedo = std::function<void(double size_m, std::span<const Vec3> directions, std::span<float> albedo,
                                        const StopToken& stop)>;

struct SlopeLightSource {
  Sun sun;
  double irradiance_w_m2;  // at normal incidence
  Brdf brdf;
  bool albedo_is_w = false;  // of Hapke's model
  GroundAlbedo albedo;       // empty: the Brdf's own
  int bounces = 1;           // or 2
};

// The share of a uniform disc above a chord at `x` radii above its middle.
double share_of_disc_above(double x);

// A source in the sky of a relief: a uniform disc, or a point.
class SkyDisc {
 public:
  SkyDisc(const Relief& relief, const Vec3& direction, double angular_radius_deg);
  const Vec3& direction() const { return direction_; }  // in the grids' axes

  // The share of the disc that each place sees above its horizon; 0 without a height. Sets the places' direction.
  // `stride`: see find_horizons().
  void shares(std::span<const GridView> grids, int stride, MarchLanes& lanes, float* share) const;

 private:
  Vec3 direction_;
  double radius_;
  MarchSphere sphere_;
};

// Thread-safe. Ground is lit when first seen: each needs a march of its own.
class SlopeLight {
 public:
  // The relief must outlive this object.
  SlopeLight(const Relief& relief, SlopeLightSource source);

  // For sixteen posts of the relief's finest grid within ReliefShape::half_m of its centre, `stride` (1, 2 or 4)
  // columns apart. Zero where there is no data.
  void gather(int row, int column, int stride, std::span<SectorLight, kPacket> out, const StopToken& stop) const;

  // Light reflected by the ground itself at a post of the finest grid, W m-2: pi times its radiance to the zenith.
  float radiosity(int row, int column, const StopToken& stop) const;

  std::size_t bytes() const;

 private:
  // Squares of cells that are lit together.
  static constexpr int kSquare = 16;
  struct Ground {
    GroundLight light;
    int squares;  // per side
    std::unique_ptr<dem::Once[]> lit, glows;
  };
  class Square;
  // What sixteen places receive by sector, for a Sun of 1 W m-2, and see of the sky; the grids' axes.
  struct alignas(64) Arriving {
    float from[kSectors][3][kPacket] = {}, sky[3][kPacket] = {};
  };
  struct Azimuths {
    int count;
    double first;  // share of the way to the second one
  };
  // Over the grids from `grid` on.
  void gather(std::size_t grid, MarchLanes& lanes, int stride, const Azimuths& azimuths, int bounces, Arriving& out,
              const StopToken& stop) const;
  // mu0 f_r of ground with an albedo, which is the map's factor or w; without a map 1.
  double reflected(double mu0, double mu, double cos_phase, double albedo) const;
  void light_cells(std::size_t grid, int row, int first_column, int last_column, int bounces,
                   const StopToken& stop) const;
  void light_square(const Square& square, const StopToken& stop) const;
  void let_glow(const Square& square, const StopToken& stop) const;

  const Relief& relief_;
  SlopeLightSource source_;
  SkyDisc disc_;
  int azimuths_;
  // Radiance in diffuse light of 1 W m-2; of an albedo that is w, for steps of sqrt(1 - w).
  double glow_of(double albedo) const;
  std::vector<double> glows_;
  mutable std::vector<Ground> ground_;
  std::vector<GridView> grids_;
};

}  // namespace selenograph::engine
