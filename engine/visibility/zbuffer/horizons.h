// Horizons of the Sun's disc: what terrain hides of each column of it from each sample of a shadow map's band.
//
// Terrain is a height field: of a column of the disc it hides all that is below some horizon, and the horizon is made
// of edges between a triangle that faces some of the disc and one that is turned away from some of it. One pass takes
// these edges from the mesh and raises the horizons of the samples that may see them before the disc, all columns at
// once. What lies more than `kAim` disc radii above its middle is not looked at: the shadow map itself is aimed there,
// and what it finds dark is dark.
//
// Seen from ten metres the disc is nine centimetres wide. So coordinates are relative to an origin beside the samples,
// and the mesh's vertices are placed anew from their posts, relative to their block.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "engine/scene/raster_mesh.h"
#include "engine/visibility/points/disc_light.h"
#include "engine/visibility/zbuffer/raster_kernels.h"

namespace selenograph::engine {

// Sixteen samples, neighbours in a band, relative to their origin in light space.
struct HorizonGroup {
  static constexpr int kSize = 16;
  double origin[3];
  alignas(64) float u[kSize], v[kSize], d[kSize];         // infinite d: not looked at
  alignas(64) float horizon[DiscLight::kColumns][kSize];  // upward from the aim: -du / dd
  bool met;                                               // some edge raised some of them
};

// Light space as it is while rows of a strip are looked at: see Horizons.
struct DiscReach {
  float columns[DiscLight::kColumns];  // across: dv / dd
  float aside;                         // of the outermost column
  float below;                         // of the disc's lower end, downward from the aim
  float above;                         // of what is looked at, upward from the aim
  float aim, radius;                   // the disc's middle, downward from the aim; tangent of its angular radius
};

// What float leaves out of a sample's coordinates.
struct LightResidual {
  float u, v, d;
};

class Horizons {
 public:
  // Where the shadow map is aimed, in disc radii above the disc's middle: what is dark there may still see a part of
  // the disc aside of a horizon that is steeper in the sky than 45 degrees.
  static constexpr double kAim = 1.4143;
  // What is looked at above that, in radii: a horizon that is below the aim in the middle may be above it aside.
  static constexpr double kAbove = 0.6;
  // Steeper terrain than this takes kSteepAim.
  static constexpr float kSteep = 1.73F;  // tangent of 60 degrees
  static constexpr double kSteepAim = 3;
  static constexpr float kSteepest = 3;  // of horizons in the sky, as good as ever

  struct Axes {
    Vec3 u, v, d;  // d toward the aim
  };
  struct Edge {
    float from[3], to[3];  // in light space, relative to their block's origin
  };

  // What float leaves out of a sample's coordinates.
  using Rest = std::function<LightResidual(std::size_t sample)>;
  // For the `count` samples of a band, which outlives the pass, as does `rest`. `aim`: in the disc's radii.
  void begin(const DiscLight& disc, double aim, const Axes& axes, const LightBand& band, std::size_t count, Rest rest);

  // Bounds of a strip in light space.
  struct Bounds {
    float u_low, u_high, v_low, v_high, d_high;
  };
  void add(const RasterMesh& mesh, const Strip& strip, const Bounds& bounds);

  // Horizons of a group of samples, upward from the disc's middle in its radii. False: nothing comes before the disc.
  // A horizon is continuous: one that leaves what was looked at, at the top, stays above the disc until it is back.
  bool of_group(std::size_t group, float (*out)[HorizonGroup::kSize]) const;

  std::size_t bytes() const;

 private:
  // Samples that see something of bounds before the disc: cells, and the lowest of them.
  struct Window {
    int c0, c1, r0, r1;
    float lowest;
  };
  bool look_below(const Bounds& bounds, float lowest, Window& out) const;
  std::int32_t slot_of(std::size_t group);
  void test(const Edge& edge, const double* origin, float lowest);

  Axes axes_;
  const LightBand* band_ = nullptr;
  DiscReach reach_{};
  std::size_t count_ = 0;
  Rest rest_;
  std::vector<std::int32_t> slots_;  // per group of samples, in groups_; -1: not looked at
  std::vector<HorizonGroup> groups_;
  std::size_t used_ = 0;  // of groups_
  float lowest_ = 0;      // of the band's samples
  std::vector<Edge> edges_;
  std::vector<std::int32_t> some_;  // of groups_: while they are looked at
};

}  // namespace selenograph::engine
