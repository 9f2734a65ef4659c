// Sunlight that terrain reflects onto terrain, once: what arrives at a place from all ground that it sees.
//
// From each place, marches along kAzimuths azimuths (march.h) find the ground that is seen and its elevation. The
// integrals over elevation are exact for ground of one radiance per step; azimuths are sampled. No random numbers, no
// noise.
#pragma once

#include <array>
#include <functional>
#include <span>
#include <vector>

#include "dem/support/stop_token.h"
#include "engine/frame/sun.h"
#include "engine/indirect/relief.h"
#include "engine/radiometry/brdf.h"

namespace selenograph::engine {

inline constexpr int kAzimuths = 128, kSectors = 8;

// What arrives at a place from the ground in each of eight sectors of azimuth: the integral of radiance times the unit
// vector to where it comes from, W m-2, MOON_ME. Its dot product with a normal is the irradiance.
struct SectorLight {
  std::array<Eigen::Vector3f, kSectors> from;
};

// The ground's albedo at unit directions, averaged over that many metres: factors of what the Brdf reflects or, for
// Hapke's model, w.
using GroundAlbedo = std::function<void(double size_m, std::span<const Vec3> directions, std::span<float> albedo)>;

struct SlopeLightSource {
  Sun sun;
  double irradiance_w_m2;  // at normal incidence
  Brdf brdf;
  bool albedo_is_w = false;  // of Hapke's model
  GroundAlbedo albedo;       // empty: the Brdf's own
};

// A source in the sky of a relief: a uniform disc, or a point.
class SkyDisc {
 public:
  SkyDisc(const Relief& relief, const Vec3& direction, double angular_radius_deg);
  const Vec3& direction() const { return direction_; }  // in the grids' axes

  // The share of the disc that each place sees above the horizon of its march; 0 without a height.
  void shares(std::span<const GridView> grids, MarchLanes& lanes, float* share) const;

 private:
  Vec3 direction_;
  double radius_;
  MarchSphere sphere_;
};

// The share of a disc that is seen from places on the ground. Parallel.
void find_shares(const Relief& relief, const SkyDisc& disc, std::span<const Vec3> places, std::span<float> out,
                 const StopToken& stop = {});

class SlopeLight {
 public:
  // Finds how the Sun lights each post of the relief, which must outlive this object. Parallel.
  SlopeLight(const Relief& relief, SlopeLightSource source, const StopToken& stop = {});

  // For unit directions (MOON_ME) of places on the ground within ReliefShape::half_m of the centre. Zero where there is
  // no data. Parallel.
  void gather(std::span<const Vec3> places, std::span<SectorLight> out, const StopToken& stop = {}) const;

  // What the ground itself gives back at these places, W m-2: pi times its radiance to the zenith.
  void radiosities(std::span<const Vec3> places, std::span<float> out) const;

 private:
  void light_cells(std::size_t grid, std::size_t first, std::size_t past_last);
  void gather_sixteen(std::span<const Vec3> places, std::span<SectorLight> out, std::vector<SeenPiece>& pieces) const;

  const Relief& relief_;
  SlopeLightSource source_;
  SkyDisc disc_;
  std::vector<std::vector<GroundLight>> light_;
  std::vector<GridView> grids_;
};

}  // namespace selenograph::engine
