// Light of the solar disc on a surface: the visible share of the disc, and the mean cosine of incidence.
//
// Places on the disc are in units of its radius: `across` (horizontal, seen from the scene) and `upward` (along the
// sky, away from the ground). In each column of the disc, terrain blocks what is below a horizon. kColumns columns
// represent the disc (Gauss-Chebyshev quadrature of the second kind, exact for smooth horizons, weighted by the disc's
// light including limb darkening).
#pragma once

#include <array>
#include <bitset>
#include <cstddef>
#include <cstdint>

#include "engine/frame/sun.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// The dot product of a normal with the unit direction to a place on the disc. It is linear in the place to within the
// disc's radius squared (1 in 50 000 for the Sun). A facet's normal may have any length.
struct DiscPlane {
  double middle = 0, across = 0, upward = 0;
  double at(double x, double y) const { return middle + across * x + upward * y; }
};

// share: share of the disc's light that arrives. cosine: mean, over all of the disc's light, of the cosine of incidence
// where the light arrives, and 0 elsewhere: the factor of the disc's irradiance at normal incidence.
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

// Planes of sixteen points: of their facets and of their shading normals.
struct DiscLanes {
  DiscPlanes facet, shading;
  // Lanes that face the whole disc, one bit each, and for these the gradient of the cosine across and upward, relative
  // to its value at the middle.
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
  // Unit direction toward a place on the disc or beside it.
  Vec3 direction(double across, double upward) const;
  float column(int j) const { return columns_[static_cast<std::size_t>(j)]; }  // position across, ascending

  DiscPlane plane(const Vec3& normal) const {
    return {normal.dot(toward_), radius_ * normal.dot(across_), radius_ * normal.dot(upward_)};
  }
  // Light on a facet without occluders, in closed form. `shading`: plane of the normal for the cosine; light counts
  // only where this normal, too, faces the Sun.
  DiscShare alone(const DiscPlane& facet, const DiscPlane& shading) const;

  // The same for sixteen points that hit, unless the Moon's interior, below all relief, hides the Sun. Sets `lit`, the
  // share, and `shading.incident`; returns the lanes that receive light, one bit each.
  std::uint32_t alone(const SurfacePoints& points, Shading& shading, DiscLanes& out, float* lit) const;

  // For sixteen points with horizons (upward, per column; kNoHorizon): the remaining part of `share` and of `cosine`,
  // relative to alone(). If all face the whole disc, their planes are not needed.
  void left(const float (*horizons)[kPacket], const DiscLanes& turned, float* of_share, float* of_cosine) const;

  // Directions of equal light (Vogel's sunflower), for occlusion that is not a horizon: objects, and ray tracing. The
  // scouts (the middle and the rim, which come first) decide whether the disc is partly hidden at all.
  static constexpr int kScouts = 14, kDirections = 256;
  struct Place {
    double across, upward;
  };
  const std::array<Place, kDirections>& places() const { return places_; }
  const std::array<Vec3, kDirections>& directions() const { return directions_; }
  using Free = std::bitset<kDirections>;  // unblocked directions

  // Reduces `lit` and incident, as set by alone(), of the `lanes` that are partly blocked. blocked(lanes, direction)
  // returns the lanes, one bit each, that are blocked in a direction. All directions are asked only of lanes about
  // which the scouts disagree, or whose facet faces too few of them to tell. free: unblocked directions per lane; may
  // be null. Returns the lanes that are partly blocked.
  template <typename Blocked>
  std::uint32_t take_out(const Blocked& blocked, std::uint32_t lanes, const DiscLanes& turned, float* lit,
                         double* incident, Free* free = nullptr) const {
    std::array<Free, kPacket> open, faced;
    const auto ask = [&](std::size_t k, std::uint32_t of) {
      std::uint32_t asking = 0;
      for (std::uint32_t i = 0; i < kPacket; ++i)
        if (of >> i & 1 && turned.facet.lane(i).at(places_[k].across, places_[k].upward) > 0) asking |= 1U << i;
      const std::uint32_t closed = asking ? blocked(asking, directions_[k]) : 0;
      for (std::uint32_t i = 0; i < kPacket; ++i)
        if (asking >> i & 1) {
          faced[i].set(k);
          open[i].set(k, !(closed >> i & 1));
        }
    };
    for (std::size_t k = 0; k < kScouts; ++k) ask(k, lanes);
    std::uint32_t doubtful = lanes & ~turned.facing_all;
    for (std::uint32_t i = 0; i < kPacket; ++i)
      if (lanes >> i & 1 && open[i].any() && open[i] != faced[i]) doubtful |= 1U << i;
    for (std::size_t k = kScouts; doubtful && k < kDirections; ++k) ask(k, doubtful);
    std::uint32_t partly = 0;
    for (std::uint32_t i = 0; i < kPacket; ++i) {
      if (!(lanes >> i & 1) || (open[i] == faced[i] && faced[i].any())) continue;
      partly |= 1U << i;
      const DiscShare left = open[i].any() ? ratio(open[i], faced[i], turned, i) : DiscShare{};
      reduce(left, lit[i], incident[i]);
      if (free) free[i] = open[i];
    }
    return partly;
  }

  // The remaining part for a lane with known free directions and horizons, as in left().
  DiscShare left_of(const Free& free, const float* horizons, std::size_t stride, const DiscLanes& turned,
                    std::uint32_t lane) const;

  // Applies a remaining part to the values set by alone().
  static void reduce(const DiscShare& left, float& lit, double& incident) {
    if (left.share > 0) incident *= left.cosine / left.share;
    lit *= static_cast<float>(left.share);
  }

  // Columns with their weights, and tables of the light above a place in them, for left().
  struct Table {
    static constexpr int kSteps = 64;
    bool even;                               // no limb darkening
    float half[kColumns], weight[kColumns];  // half length; share of the disc's light
    // Share of the column's light above a place, from its lower to its upper end, and the first moment of that light in
    // `upward`.
    float above[kColumns][kSteps + 2], moment[kColumns][kSteps + 2];
  };

 private:
  // Columns of equal angular width, for facets bounded by two chords.
  static constexpr int kFine = 32;
  struct FineColumn {
    double across, half, weight;  // weights sum to 1 over the disc's light
  };

  DiscShare ratio(const Free& open, const Free& faced, const DiscLanes& turned, std::uint32_t lane) const;

  Vec3 toward_, across_, upward_;
  double radius_, darkening_;
  std::array<float, kColumns> columns_;
  Table table_;
  std::array<FineColumn, kFine> fine_;
  std::array<Place, kDirections> places_;
  std::array<Vec3, kDirections> directions_;
};

}  // namespace selenograph::engine
