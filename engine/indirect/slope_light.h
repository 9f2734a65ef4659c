// Sunlight that terrain reflects onto terrain: the light at a point from all ground in its view. With more bounces that
// ground also reflects the light of the bounces before.
//
// From each point, marches along azimuths (engine/relief/ground_march.h) find the visible ground and its elevation.
// That view depends on no light, so it is kept for other Suns. Integrals over elevation are exact for ground of one
// radiance per step; azimuths are sampled, without random numbers.
#pragma once

#include <array>
#include <atomic>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "dem/base/cache.h"
#include "dem/base/once.h"
#include "dem/base/stop_token.h"
#include "engine/frame/sun.h"
#include "engine/indirect/segment_light.h"
#include "engine/radiometry/brdf.h"
#include "engine/relief/ground_march.h"
#include "engine/relief/relief.h"
#include "engine/support/content_key.h"

namespace selenograph::engine {

inline constexpr int kSectors = 8;
// Azimuths per post. The next row's lie halfway between them, so an interpolated point samples twice as many. At a low
// Sun only thin strips are lit, and more azimuths are needed to hit them.
inline constexpr int kAzimuths = 32, kAzimuthsAtLowSun = 64;
inline constexpr double kLowSun_deg = 10;
// Azimuths for the second bounce: far more points of it are averaged.
inline constexpr int kAzimuthsOfGround = 32;

// Light at a point from the ground in each of eight sectors of azimuth: the integral of radiance times the unit vector
// toward the source, W m-2, MOON_ME. Its dot product with a normal is the irradiance.
struct SectorLight {
  std::array<Vec3f, kSectors> from;
  // Integral of the unit vector over the sky: a plane with normal n sees n . sky / pi of its hemisphere as sky.
  Vec3f sky;
};

// Sets the ground's albedo at unit directions, averaged over `size_m` metres: factors of the Brdf's reflectance or, for
// Hapke's model, w.
using GroundAlbedo = std::function<void(double size_m, std::span<const Vec3> directions, std::span<float> albedo,
                                        const StopToken& stop)>;

struct SlopeLightSource {
  Sun sun;
  double irradiance_w_m2;  // the Sun's, at normal incidence
  Brdf brdf;
  bool albedo_is_w = false;  // the albedo is Hapke's w
  GroundAlbedo albedo;       // empty: the Brdf's own albedo
  int bounces = 1;           // 1 to kMaxBounces
};

// Returns the share of a uniform disc above a chord that lies `x` radii above the disc's middle.
double share_of_disc_above(double x);

// A source in the sky of a relief: a uniform disc, or a point.
class SkyDisc {
 public:
  // The relief must outlive this object.
  SkyDisc(const Relief& relief, const Vec3& direction, double angular_radius_deg);
  const Vec3& direction() const { return direction_; }  // unit vector in the grids' axes

  // Sets the share of the disc that each point sees above its horizon; 0 without a height. Overwrites the lanes'
  // direction. `first_grid`: the finest grid that may hide the disc; `stride`: see find_horizon_ahead().
  void shares(std::size_t first_grid, int stride, MarchLanes& lanes, float* share) const;

 private:
  const Relief& relief_;
  Vec3 direction_;
  double radius_;  // angular, rad
};

// Keeps views of a relief's ground, under keys that begin with the relief's. Without `views` none are kept.
struct GroundViewStore {
  using Views = dem::Cache<ContentKey, GroundView, ContentKeyHash>;
  Views* views = nullptr;
  ContentKey relief{};
};

// Time that threads spend on parts of the light at posts (LightTimes), ms. Thread-safe.
struct LightWork {
  std::atomic<double> views_ms{0}, sunlit_ms{0}, bounces_ms{0};
};

// Light on a relief's ground, and from there at its posts. Thread-safe. Ground is lit on demand, because each cell
// needs a march of its own.
class SlopeLight {
 public:
  // The relief and the store must outlive this object.
  SlopeLight(const Relief& relief, SlopeLightSource source, const GroundViewStore& store = {});

  // Gathers the light at sixteen posts of the relief's finest grid, `stride` (1, 2 or 4) columns apart, within
  // ReliefShape::half_m of its centre. Zero without data. `keep_view`: store the posts' view of the ground; the result
  // does not depend on it. `work`: adds its times; may be null.
  void gather(int row, int column, int stride, std::span<SectorLight, kPacket> out, const StopToken& stop,
              bool keep_view = false, LightWork* work = nullptr) const;

  // Returns the light that the ground itself reflects at a post of the finest grid, W m-2: pi times its radiance to the
  // zenith.
  float radiosity(int row, int column, const StopToken& stop) const;

  std::size_t bytes() const;

 private:
  // Side of a square of cells that one call lights.
  static constexpr int kSquare = 16;
  struct Squares {
    int per_side;
    // Guards per square: `lit` for sunlight, `glows` for light from other ground, see GroundLight::glow.
    std::unique_ptr<dem::Once[]> lit;
    std::array<std::unique_ptr<dem::Once[]>, kMaxBounces - 1> glows;
  };
  class Square;
  // Light at sixteen points by sector, for a Sun of 1 W m-2, and their view of the sky; the grids' axes.
  struct alignas(64) ArrivingLight {
    float from[kSectors][3][kPacket] = {}, sky[3][kPacket] = {};
  };
  struct Azimuths {
    int count;
    double first;  // the first azimuth, as a share of the step to the second
  };
  // Sixteen points that gather light: posts of a grid or middles of its cells, from this row and column on, `stride`
  // columns of the finest grid apart.
  struct Gatherers {
    std::size_t grid;
    int row, column, stride;
    bool of_cells;
    Azimuths azimuths;
  };
  // Returns the points' view over the grids from theirs on, from the store or by marches. Overwrites the directions of
  // `lanes` and `directions`.
  std::shared_ptr<const GroundView> view_of(const Gatherers& gatherers, MarchLanes& lanes, AzimuthLanes& directions,
                                            bool keep_view, const StopToken& stop) const;
  GroundView march_view(const Gatherers& gatherers, MarchLanes& lanes, AzimuthLanes& directions) const;
  // Sets the squares of a view, whose first grid is `first_grid`.
  void set_squares(std::size_t first_grid, GroundView& view) const;
  // Gathers light of up to this number of bounces.
  void gather(const Gatherers& gatherers, MarchLanes& lanes, int bounces, bool keep_view, ArrivingLight& out,
              const StopToken& stop, LightWork* work = nullptr) const;
  // Returns mu0 f_r of the ground. `albedo`: the map's factor or w; 1 without a map.
  double reflected(double mu0, double mu, double cos_phase, double albedo) const;
  // Lights squares of cells, unless they are lit: by the Sun, and by other ground for light of up to this number of
  // bounces.
  void light_squares(std::span<const GroundView::Square> squares, int bounces, const StopToken& stop,
                     LightWork* work = nullptr) const;
  // Sets normals, albedo and visible share of the Sun's disc in a square of cells.
  void light_in_sun(const Square& square, const StopToken& stop) const;
  // Sets the square's glow: the light of other ground, of up to this number of bounces, that it reflects.
  void light_by_ground(const Square& square, int bounces, const StopToken& stop) const;

  const Relief& relief_;
  SlopeLightSource source_;
  GroundViewStore store_;
  SkyDisc disc_;  // the Sun's disc
  int azimuths_;  // number of azimuths per post
  // Returns the ground's radiance in diffuse light of 1 W m-2.
  double glow_of(double albedo) const;
  // Table of glow_of(): a single value, for albedo 1, or if the albedo is w, values at equal steps of sqrt(1 - w).
  std::vector<double> glows_;
  mutable std::vector<LitGrid> ground_;
  std::vector<Squares> squares_;  // of each grid
};

}  // namespace selenograph::engine
