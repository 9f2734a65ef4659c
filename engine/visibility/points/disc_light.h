// Light of the solar disc on a surface: the visible share of the disc, and the mean cosine of incidence.
//
// Points of the disc are in units of its radius: `across` (horizontal, as seen from the scene) and `upward` (in the
// sky, away from the ground). In each column of the disc, terrain blocks the part below a horizon. kColumns columns
// represent the disc by Gauss-Chebyshev quadrature of the second kind, exact for smooth horizons; their weights include
// limb darkening.
#pragma once

#include <array>
#include <bitset>
#include <cstddef>
#include <cstdint>

#include "engine/frame/sun.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// The dot product of a normal with the unit direction to a point of the disc. It is linear in that point to within the
// square of the radius of the disc (1 in 50 000 for the Sun). The normal of a facet may have any length.
struct DiscPlane {
  double middle = 0, across = 0, upward = 0;
  double at(double x, double y) const { return middle + across * x + upward * y; }
};

// share: share of the light of the disc that arrives. cosine: mean of the cosine of incidence over the light of the
// disc, counted as 0 where the light is blocked; it is the ratio of irradiance to that at normal incidence.
struct DiscShare {
  double share = 0, cosine = 0;
};

// Sixteen planes in float.
struct DiscPlanes {
  alignas(64) float middle[kPacket];
  alignas(64) float across[kPacket];
  alignas(64) float upward[kPacket];
  DiscPlane lane(std::size_t i) const {
    return {static_cast<double>(middle[i]), static_cast<double>(across[i]), static_cast<double>(upward[i])};
  }
};

// Planes of the facets and of the shading normals of sixteen points.
struct DiscLanes {
  DiscPlanes facet, shading;
  // Lanes that face the whole disc, one bit each. For these, the gradient of the cosine across and upward, relative to
  // the cosine at the middle.
  std::uint32_t facing_all;
  alignas(64) float tilt_across[kPacket];
  alignas(64) float tilt_upward[kPacket];
};

class DiscLight {
 public:
  static constexpr int kColumns = 7;
  static constexpr float kNoHorizon = -1e9F;

  // `up`: direction away from the ground at the scene.
  DiscLight(const Sun& sun, const Vec3& up);

  double radius() const { return radius_; }  // tangent of the angular radius
  // Unit direction toward a point of the disc or next to it.
  Vec3 direction(double across, double upward) const;
  float column(int j) const { return columns_[static_cast<std::size_t>(j)]; }  // position of a column across, ascending

  DiscPlane plane(const Vec3& normal) const {
    return {normal.dot(toward_), radius_ * normal.dot(across_), radius_ * normal.dot(upward_)};
  }
  // Returns the light on a facet without occluders: only the facet itself and its shading normal hide part of the disc.
  // `shading`: plane of the normal for the cosine; light counts only where this normal, too, faces the Sun.
  DiscShare unoccluded(const DiscPlane& facet, const DiscPlane& shading) const;

  // Computes the same for sixteen points that are hit. The interior of the Moon, below all relief, may hide the Sun.
  // Sets `lit` to the share, and `shading.incident`. Returns the lanes that receive light, one bit each.
  std::uint32_t unoccluded(const SurfacePoints& points, Shading& shading, DiscLanes& out, float* lit) const;

  // Sets the factors by which horizons (upward, per column; kNoHorizon) reduce the share and the cosine of
  // unoccluded(). The planes of `disc_lanes` are needed only if some lane does not face the whole disc.
  void remaining(const float (*horizons)[kPacket], const DiscLanes& disc_lanes, float* share_factor,
                 float* cosine_factor) const;

  // Directions of equal light (Vogel's sunflower), for occlusion that is not a horizon: by objects, and in ray tracing.
  // The first kScouts of them, the middle and the rim, decide whether the disc is partly hidden at all.
  static constexpr int kScouts = 14, kDirections = 256;
  struct DiscPoint {
    double across, upward;
  };
  const std::array<DiscPoint, kDirections>& disc_points() const { return disc_points_; }
  const std::array<Vec3, kDirections>& directions() const { return directions_; }
  using FreeDirections = std::bitset<kDirections>;  // unblocked directions

  // Reduces `lit` and `incident`, as set by unoccluded(), for those of `lanes` that are partly blocked. blocked(lanes,
  // direction) returns the lanes, one bit each, that are blocked in a direction. Directions other than the scouts are
  // tested only for lanes whose scouts disagree or whose facet does not face the whole disc. free: unblocked directions
  // per lane; may be null. Returns the partly blocked lanes.
  template <typename Blocked>
  std::uint32_t remove_blocked(const Blocked& blocked, std::uint32_t lanes, const DiscLanes& disc_lanes, float* lit,
                               double* incident, FreeDirections* free = nullptr) const {
    std::array<FreeDirections, kPacket> open, faced;
    const auto test_direction = [&](std::size_t k, std::uint32_t tested) {
      std::uint32_t facing = 0;
      for (std::uint32_t i = 0; i < kPacket; ++i)
        if (tested >> i & 1 && disc_lanes.facet.lane(i).at(disc_points_[k].across, disc_points_[k].upward) > 0)
          facing |= 1U << i;
      const std::uint32_t hidden = facing ? blocked(facing, directions_[k]) : 0;
      for (std::uint32_t i = 0; i < kPacket; ++i)
        if (facing >> i & 1) {
          faced[i].set(k);
          open[i].set(k, !(hidden >> i & 1));
        }
    };
    for (std::size_t k = 0; k < kScouts; ++k) test_direction(k, lanes);
    std::uint32_t undecided = lanes & ~disc_lanes.facing_all;
    for (std::uint32_t i = 0; i < kPacket; ++i)
      if (lanes >> i & 1 && open[i].any() && open[i] != faced[i]) undecided |= 1U << i;
    for (std::size_t k = kScouts; undecided && k < kDirections; ++k) test_direction(k, undecided);
    std::uint32_t partly = 0;
    for (std::uint32_t i = 0; i < kPacket; ++i) {
      if (!(lanes >> i & 1) || (open[i] == faced[i] && faced[i].any())) continue;
      partly |= 1U << i;
      const DiscShare remaining = open[i].any() ? ratio(open[i], faced[i], disc_lanes, i) : DiscShare{};
      reduce(remaining, lit[i], incident[i]);
      if (free) free[i] = open[i];
    }
    return partly;
  }

  // Returns the remaining factors, as remaining() does, of a lane with known free directions and horizons.
  DiscShare remaining_with_objects(const FreeDirections& free, const float* horizons, std::size_t stride,
                                   const DiscLanes& disc_lanes, std::uint32_t lane) const;

  // Applies the remaining factors to the values set by unoccluded().
  static void reduce(const DiscShare& remaining, float& lit, double& incident) {
    if (remaining.share > 0) incident *= remaining.cosine / remaining.share;
    lit *= static_cast<float>(remaining.share);
  }

  // Columns with their weights, and tables of the light above a position in them, for remaining().
  struct Table {
    static constexpr int kSteps = 64;
    bool even;                               // no limb darkening
    float half[kColumns], weight[kColumns];  // half length; share of the light of the disc
    // Share of the light of the column above a position, from its lower to its upper end, and the first moment of that
    // light in `upward`.
    float above[kColumns][kSteps + 2], moment[kColumns][kSteps + 2];
  };

 private:
  // Columns of equal angular width, for facets bounded by two chords.
  static constexpr int kFine = 32;
  struct FineColumn {
    double across, half, weight;  // weights sum to 1 over the light of the disc
  };

  DiscShare ratio(const FreeDirections& open, const FreeDirections& faced, const DiscLanes& disc_lanes,
                  std::uint32_t lane) const;

  Vec3 toward_, across_, upward_;
  double radius_, darkening_;
  std::array<float, kColumns> columns_;
  Table table_;
  std::array<FineColumn, kFine> fine_;
  std::array<DiscPoint, kDirections> disc_points_;
  std::array<Vec3, kDirections> directions_;
};

}  // namespace selenograph::engine
