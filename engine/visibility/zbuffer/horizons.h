// Horizons in front of the solar disc: what terrain hides of each column of the disc, for each sample of a shadow map's
// band.
//
// Terrain is a height field: in a column of the disc it hides everything below a horizon, and horizons consist of edges
// between a triangle that faces part of the disc and one that is turned away from part of it. One pass takes these
// edges from the mesh and raises the horizons of the samples behind them, all columns at once. Terrain more than
// `kAim` + `kAbove` radii above the middle of the disc is not examined here: the shadow map is aimed at `kAim`, and
// samples that are dark in it are dark.
//
//          aim  x                    the disc as a sample sees it, with its columns
//             .----.
//           / | |  | \__            the silhouette edges of terrain; in each column, the light below the
//     _____|__|_|__|_|  \__          highest edge is blocked
//     terrain \ |  | /
//              `--'
//
// At ten metres the disc covers nine centimetres. Coordinates are therefore relative to an origin near the samples, and
// the mesh's vertices are recomputed from their posts, relative to their block.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "engine/scene/raster_mesh.h"
#include "engine/visibility/points/disc_light.h"
#include "engine/visibility/zbuffer/raster_kernels.h"
#include "engine/visibility/zbuffer/shadow_reach.h"

namespace selenograph::engine {

// Sixteen neighbouring samples of a band, relative to their origin in light space.
struct HorizonGroup {
  static constexpr int kSize = 16;
  double origin[3];
  alignas(64) float u[kSize];
  alignas(64) float v[kSize];
  alignas(64) float d[kSize];                             // infinite: ignored
  alignas(64) float horizon[DiscLight::kColumns][kSize];  // upward from the aim: -du / dd
  bool raised;                                            // an edge has raised a horizon
};

// Position and size of the disc, as slopes relative to the aim; multiplied by a height difference d, they are distances
// in u or v.
struct DiscReach {
  float columns[DiscLight::kColumns];  // slope dv / dd of each column
  float aside;                         // slope of the outermost column
  float below;                         // the disc's lower end, downward from the aim
  float above;                         // limit of what is examined, upward from the aim
  float aim, radius;                   // the disc's middle, downward from the aim; tangent of its angular radius
};

// Rounding residual of a sample's float coordinates.
struct LightResidual {
  float u, v, d;
};

class Horizons {
 public:
  // Aim of the shadow map, in disc radii above the disc's middle. A point that is dark there may still see part of the
  // disc beside a horizon that is steeper in the sky than 45 degrees.
  static constexpr double kAim = 1.4143;
  // Range examined above the aim, in radii: a horizon that is below the aim in the middle may be above it at the side.
  static constexpr double kAbove = 0.6;
  // Terrain steeper than this uses kSteepAim.
  static constexpr float kSteep = 1.73F;  // tangent of 60 degrees
  static constexpr double kSteepAim = 3;
  static constexpr float kSteepest = 3;  // horizon slope in the sky up to which accuracy holds

  struct Axes {
    Vec3 u, v, d;  // d toward the aim
  };
  struct Edge {
    float from[3], to[3];  // in light space, relative to the block's origin
  };

  // Returns the rounding residual of the coordinates of a sample.
  using ResidualOf = std::function<LightResidual(std::size_t sample)>;
  // Begins a pass for the `count` samples of a band. `band` and `residual_of` must outlive the pass. `aim`: in disc
  // radii.
  void begin(const DiscLight& disc, double aim, const Axes& axes, const LightBand& band, std::size_t count,
             ResidualOf residual_of);

  // Raises horizons by the edges of a strip. `bounds`: the bounding box of the strip.
  void add(const RasterMesh& mesh, const Strip& strip, const LightBox& bounds);

  // Sets `out` to the horizons of a group of samples, upward from the middle of the disc, in its radii. Returns false
  // if nothing is in front of the disc. Horizons are continuous: one that leaves the examined range at the top stays
  // above the disc until it comes back.
  bool of_group(std::size_t group, float (*out)[HorizonGroup::kSize]) const;

  std::size_t bytes() const;

 private:
  // Cells (columns c0 to c1, rows r0 to r1 of the band) of samples before whose disc something within the bounds may
  // stand, and the lowest d of these samples.
  struct Window {
    int c0, c1, r0, r1;
    float lowest;
  };
  bool find_window(const LightBox& bounds, float lowest, Window& out) const;
  std::int32_t slot_of(std::size_t group);
  void raise_behind(const Edge& edge, const double* origin, float lowest);

  Axes axes_;
  const LightBand* band_ = nullptr;
  DiscReach reach_{};
  std::size_t count_ = 0;
  ResidualOf residual_of_;
  std::vector<std::int32_t> slots_;  // index into groups_ per group of samples; -1: none
  std::vector<HorizonGroup> groups_;
  std::size_t used_ = 0;  // number of groups_ in use
  float lowest_ = 0;      // lowest d of the samples of the band
  std::vector<Edge> edges_;
  std::vector<std::int32_t> group_slots_;  // indices of the groups that the current edge is tested against
};

}  // namespace selenograph::engine
