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

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "dem/base/uninitialised.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// At a distance d a step is d / kStepsPerDistance long, at least the finest grid's spacing. It reads the coarsest grid
// of which it spans kPostsPerStep posts.
inline constexpr float kStepsPerDistance = 24, kPostsPerStep = 2;

// Largest number of reflections of light from terrain.
inline constexpr int kMaxBounces = 3;

// Light on the cells of a grid, as arrays like the grid's heights. A cell lies between four posts.
struct GroundLight {
  using Values = dem::UninitialisedVector<float>;
  Values nx, ny;  // unit normal in the grids' axes; its z is positive
  Values lit;     // visible share of the Sun's disc; 0 without data
  Values albedo;  // the ground's albedo by the maps; empty without a map: 1 everywhere
  // Radiance of light from other ground, for a Sun of 1 W m-2: of one bounce, of up to two; empty where not needed.
  std::array<Values, kMaxBounces - 1> glow;
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

// Ground that one step of a march adds to the view of sixteen points: its cells, and how far the tangent of each lane's
// horizon rises there.
struct GroundSegment {
  float column;       // of the first lane's cell; the others are RowOfCells::pitch apart
  std::uint16_t row;  // of the cells
  std::uint8_t grid;
  std::uint8_t unused = 0;
  // Numbers with five bits of exponent and three of mantissa, from 2^-24 on; 0 in lanes that see nothing. A rise is
  // that from the sum of the lane's rises so far, so that their rounding errors do not add up.
  std::uint8_t rise[kPacket];
};
static_assert(sizeof(GroundSegment) == 24);

// The ground that sixteen points in a row see. It depends on no light.
struct GroundView {
  struct alignas(64) Azimuth {
    float first_tangent[kPacket];  // horizons where they begin; 0 without ground
    float ux, uy;                  // unit vector of the direction
    std::uint32_t past_last;       // index of the segment after this azimuth's; they begin where the last azimuth's end
  };
  // A square of cells, by its index in a grid.
  struct Square {
    std::uint32_t grid, index;
  };
  int stride = 1;  // columns of the finest grid from point to point
  std::vector<Azimuth> azimuths;
  std::vector<GroundSegment> segments;  // by azimuth, nearest first
  std::vector<Square> squares;          // squares with cells of any segment
  float sky[3][kPacket] = {};           // sum over azimuths of the direction's integral over the sky, see add_sky()
  std::size_t bytes() const {
    return sizeof *this + azimuths.capacity() * sizeof(Azimuth) + segments.capacity() * sizeof(GroundSegment) +
           squares.capacity() * sizeof(Square);
  }
};

// Appends an azimuth, the lanes' direction, to a view. Sets horizon[i] as find_horizons() does.
void find_visible_ground(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes,
                         GroundView& view, float* horizon);

// Visible ground of a segment, from the old horizons to the new ones.
struct VisibleSegment {
  // Leaves all members uninitialised: each is written next.
  VisibleSegment() {}  // NOLINT(modernize-use-equals-default)
  // Integrals of cos^2 e and of sin e cos e over the segment's elevations e; 0 in lanes that see nothing of it.
  alignas(64) float along[kPacket];
  alignas(64) float up[kPacket];
  alignas(64) float tangent[kPacket];  // tangent of the elevation of its middle
};

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

// Position in an azimuth of a view, with the horizons there.
struct alignas(64) SegmentCursor {
  float horizon[kPacket];  // tangents
  std::size_t segment, past_last;
  SegmentCursor(const GroundView& view, std::size_t azimuth);
};
// Advances to the next segment whose ground sends light to any lane, and reads that light. Returns false if there is
// none. `glow`: number of the ground's glow to read, see GroundLight; -1: sunlight only. All cells of the view must be
// lit.
bool next_lit_segment(const GroundView& view, std::span<const GridView> grids, const AzimuthLanes& lanes, int glow,
                      SegmentCursor& cursor, VisibleSegment& segment, SegmentLight& light);

// Adds the light that a segment sends to the sixteen points to their sums, by x, y and z: integrals of radiance times
// direction. `reflected`: mu0 f_r of its ground; `times_albedo`: multiply it by the segment's albedo, which `reflected`
// does not yet contain.
void add_segment(const VisibleSegment& segment, const AzimuthLanes& lanes, const SegmentLight& light,
                 const double* reflected, bool times_albedo, float (*sum)[kPacket]);

// Adds the integral of the unit direction over the sky above the horizon, with an error of at most 1 %.
void add_sky(const AzimuthLanes& lanes, const float* horizon, float (*sum)[kPacket]);

}  // namespace selenograph::engine
