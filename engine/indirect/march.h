// Marches along great circles over nested grids of heights (relief.h), sixteen points at a time.
//
// A march looks along one azimuth and keeps the highest elevation so far, the horizon. The ground of a step is visible
// if it rises above the horizon; it is then a segment, from the old horizon to the new one.
//
//                       ___  visible         . . . line of sight over the last crest
//    point    visible  /   \     . . . . . _____
//      o     ____.----'     \  hidden     /     \ visible
//       \___/                \___________/       \____
//    |--|--|--|--|--|--|--|----|----|------|------|-----   steps: the finest spacing, then 1/24 of the distance;
//                                                          quarter steps around crests and walls
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "dem/base/uninitialised.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// At a distance d a step is d / kStepsPerDistance long, at least the finest grid's spacing. It reads the coarsest grid
// of which it spans kPostsPerStep posts.
inline constexpr float kStepsPerDistance = 24, kPostsPerStep = 2;

// Light on the cells of a grid, as arrays like the grid's heights. A cell lies between four posts.
struct GroundLight {
  using Values = dem::UninitialisedVector<float>;
  Values nx, ny;  // unit normal in the grids' axes; its z is positive
  Values lit;     // visible share of the Sun's disc; 0 without data
  Values albedo;  // the ground's albedo by the maps; empty without a map: 1 everywhere
  Values glow;    // radiance of light from other ground, for a Sun of 1 W m-2; empty with one bounce
};

// Extra elements at the end of each array, because rows are read in full vectors.
inline constexpr std::size_t kPadding = 4 * kPacket;

// A square grid of a relief, as marches read it.
struct GridView {
  const float* heights;      // m above the reference; NaN: no data
  const GroundLight* light;  // light on the cell north-east of each post; may be null
  float first_m, spacing_m;  // coordinate of row 0 and of column 0; distance between posts
  float posts_per_m;         // 1 / spacing_m
  float coarser;             // spacing_m over the finest grid's: a power of two
  int side;
  float highest_m;  // greatest height of this grid and the coarser ones
};

// Sixteen points in a row, equally spaced in x, and their common direction; the grids' coordinates.
struct alignas(64) MarchLanes {
  float x[kPacket], y;                // m
  alignas(64) float height[kPacket];  // m above the reference
  float ux, uy;                       // unit vector of the direction
};

struct MarchSphere {
  float reference_radius_m;  // radius of height 0
  float datum_radius_m;      // distance of the plane of the coordinates (gnomonic projection) from the Moon's centre
  float farthest_m;          // distance at which marches end
};

// Sets tangent[i] to the tangent of the horizon's elevation at each lane; -infinity without any ground. A march may end
// once each horizon is above sufficient_tangent[i]. Lanes i and i + 1 are `stride` columns of the finest grid apart, a
// power of two.
void find_horizons(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes, int stride,
                   const float* sufficient_tangent, float* tangent);

// Cells of a grid that sixteen points in a row reach at equal distance: one row, columns `column + i * pitch`.
struct RowOfCells {
  int row;
  float column, pitch;  // pitch: columns from lane to lane, 4, 2, 1, 1/2 ...
  float north;          // share of the way to the next row, 0 to 1
};

// Ground that one step of a march adds to the view of sixteen points.
struct VisibleSegment {
  // Leaves all members uninitialised: each is written next.
  VisibleSegment() {}  // NOLINT(modernize-use-equals-default)
  // Integrals of cos^2 e and of sin e cos e over the segment's elevations e; 0 in lanes that see nothing of it.
  alignas(64) float along[kPacket];
  alignas(64) float up[kPacket];
  alignas(64) float tangent[kPacket];  // tangent of the elevation of its middle
  std::size_t grid;
  RowOfCells cells;  // cells at its middle
};

// Appends the visible ground to `segments`, nearest first. Sets horizon[i] as find_horizons() does.
void find_visible_segments(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes,
                           int stride, std::vector<VisibleSegment>& segments, float* horizon);

// Directions at sixteen points that look along one azimuth, in the grids' axes.
struct alignas(64) AzimuthLanes {
  float along[3][kPacket], up[3][kPacket];  // unit vectors: level toward the azimuth; vertical
  float sun[3];                             // unit vector to the Sun
};

// Light on the ground of a segment, with cosines of incidence, emission and phase toward the sixteen points.
struct alignas(64) SegmentLight {
  double mu0[kPacket], mu[kPacket], cos_phase[kPacket], albedo[kPacket];
  float lit[kPacket], glow[kPacket];
};
// Reads the light on a segment's ground. Returns false if it is dark. `with_glow`: also light from other ground.
bool light_segment(const VisibleSegment& segment, const GridView& grid, const AzimuthLanes& lanes, bool with_glow,
                   SegmentLight& out);

// Adds the light that a segment sends to the sixteen points to their sums, by x, y and z: integrals of radiance times
// direction. `reflected`: mu0 f_r of its ground; `times_albedo`: multiply it by the segment's albedo, which `reflected`
// does not yet contain.
void add_segment(const VisibleSegment& segment, const AzimuthLanes& lanes, const SegmentLight& light,
                 const double* reflected, bool times_albedo, float (*sum)[kPacket]);

// Adds the integral of the unit direction over the sky above the horizon, with an error of at most 1 %.
void add_sky(const AzimuthLanes& lanes, const float* horizon, float (*sum)[kPacket]);

}  // namespace selenograph::engine
