// Light that the ground in view sends to sixteen points, segment by segment of their views (GroundView).
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "dem/base/uninitialised.h"
#include "engine/relief/ground_march.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

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

struct LitGrid {
  const ReliefGrid* grid;
  GroundLight light;
};

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
// none. `ground`: of the view's grids, from its first one on; all cells of the view must be lit. `glow`: number of the
// ground's glow to read, see GroundLight; -1: sunlight only.
bool next_lit_segment(const GroundView& view, std::span<const LitGrid> ground, const AzimuthLanes& lanes, int glow,
                      SegmentCursor& cursor, VisibleSegment& segment, SegmentLight& light);

// Adds the light that a segment sends to the sixteen points to their sums, by x, y and z: integrals of radiance times
// direction. `reflected`: mu0 f_r of its ground; `times_albedo`: multiply it by the segment's albedo, which `reflected`
// does not yet contain.
void add_segment(const VisibleSegment& segment, const AzimuthLanes& lanes, const SegmentLight& light,
                 const double* reflected, bool times_albedo, float (*sum)[kPacket]);

// Adds the integral of the unit direction over the sky above the horizon, with an error of at most 1 %.
void add_sky(const AzimuthLanes& lanes, const float* horizon, float (*sum)[kPacket]);

}  // namespace selenograph::engine
