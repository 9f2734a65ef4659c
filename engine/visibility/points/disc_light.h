// The Sun's disc as a surface receives it: how much of its light a point sees, and how steeply that falls in.
//
// Places on the disc are in units of its radius: `across` (level, seen from the scene) and `upward` (along the sky,
// away from the ground). Terrain blocks, of each column of the disc, what is below a horizon: kColumns of them stand
// for the disc (Gauss-Chebyshev quadrature of the second kind, exact for smooth horizons and weighed by the disc's
// light, limb darkening included).
#pragma once

#include <array>
#include <bitset>
#include <cstddef>
#include <cstdint>

#include "engine/frame/sun.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// Of a normal: its product with the unit direction to a place on the disc, which is linear in the place to within the
// disc's radius squared (a part in 50 000 for the Sun). A facet's normal may have any length.
struct DiscPlane {
  double middle = 0, across = 0, upward = 0;
  double at(double x, double y) const { return middle + across * x + upward * y; }
};

// share: of the disc's light, that arrives. cosine: mean, over all of the disc's light, of the cosine of incidence
// where it arrives, else 0: what the disc's irradiance at normal incidence is multiplied by.
struct DiscShare {
  double share = 0, cosine = 0;
};

// Sixteen planes, as floats.
struct DiscPlanes {
  alignas(64) float middle[kPacket], across[kPacket], upward[kPacket];
  DiscPlane lane(std::size_t i) const {
    return {static_cast<double>(middle[i]), static_cast<double>(across[i]), static_cast<double>(upward[i])};
  }
};

// Of sixteen points, their facets and the normals that they are shaded by.
struct DiscLanes {
  DiscPlanes facet, shading;
  // Those that face all of the disc, a bit each, and of these how steeply the cosine grows across and upward, in parts
  // of its value at the middle.
  std::uint32_t whole;
  alignas(64) float tilt_across[kPacket], tilt_upward[kPacket];
};

class DiscLight {
 public:
  static constexpr int kColumns = 7;
  static constexpr float kNoHorizon = -1e9F;

  // `up`: away from the ground at the scene.
  DiscLight(const Sun& sun, const Vec3& up);

  double radius() const { return radius_; }  // tangent of the angular radius
  // Unit, toward a place on the disc or beside it.
  Vec3 direction(double across, double upward) const;
  float column(int j) const { return columns_[static_cast<std::size_t>(j)]; }  // across, ascending

  DiscPlane plane(const Vec3& normal) const {
    return {normal.dot(toward_), radius_ * normal.dot(across_), radius_ * normal.dot(upward_)};
  }
  // What a facet receives whose surroundings block nothing, in closed form. `shading`: the plane of the normal that
  // cosines are taken of; light counts only where it faces the Sun, too.
  DiscShare alone(const DiscPlane& facet, const DiscPlane& shading) const;

  // The same of sixteen points that hit, unless the solid inside of the Moon, below all relief, stands between. Sets
  // `lit`, the share, and `shading.incident`; returns the lanes to which some light comes, a bit each.
  std::uint32_t alone(const SurfacePoints& points, Shading& shading, DiscLanes& out, float* lit) const;

  // Sixteen points under horizons (upward, per column; kNoHorizon): which part is left of what each would receive
  // alone. Of `share` and of `cosine`. Where all face the whole disc, their planes are not needed.
  void left(const float (*horizons)[kPacket], const DiscLanes& turned, float* of_share, float* of_cosine) const;

  // Directions of equal light (Vogel's sunflower), for whatever is not a horizon: objects, and rays. A few tell whether
  // the disc is in doubt at all: the middle and the rim come first.
  static constexpr int kScouts = 14, kDirections = 256;
  struct Place {
    double across, upward;
  };
  const std::array<Place, kDirections>& places() const { return places_; }
  const std::array<Vec3, kDirections>& directions() const { return directions_; }
  using Free = std::bitset<kDirections>;  // directions in which nothing stands

  // blocked(lanes, direction) says from which of these lanes' points something stands in that direction, a bit each.
  // Takes that out of the `lanes`' lit and incident, as alone() has set them. The directions are asked for one after
  // the other, all but the scouts only where these disagree about some lane. free: per lane; may be null. Returns the
  // lanes of which a part is blocked.
  template <typename Blocked>
  std::uint32_t take_out(const Blocked& blocked, std::uint32_t lanes, const DiscLanes& turned, float* lit,
                         double* incident, Free* free = nullptr) const {
    std::array<Free, kPacket> open, faced;
    const auto ask = [&](std::size_t k) {
      std::uint32_t asking = 0;
      for (std::uint32_t i = 0; i < kPacket; ++i)
        if (lanes >> i & 1 && turned.facet.lane(i).at(places_[k].across, places_[k].upward) > 0) asking |= 1U << i;
      const std::uint32_t closed = asking ? blocked(asking, directions_[k]) : 0;
      for (std::uint32_t i = 0; i < kPacket; ++i)
        if (asking >> i & 1) faced[i].set(k), open[i].set(k, !(closed >> i & 1));
    };
    for (std::size_t k = 0; k < kScouts; ++k) ask(k);
    bool doubt = false;
    for (std::uint32_t i = 0; i < kPacket; ++i)
      if (lanes >> i & 1) doubt |= faced[i].none() || (open[i].any() && open[i] != faced[i]);
    if (doubt)
      for (std::size_t k = kScouts; k < kDirections; ++k) ask(k);
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

  // Of a lane whose free directions are known, under horizons besides: as left() has it.
  DiscShare left_of(const Free& free, const float* horizons, std::size_t stride, const DiscLanes& turned,
                    std::uint32_t lane) const;

  // Takes a part out of what alone() has set.
  static void reduce(const DiscShare& left, float& lit, double& incident) {
    if (left.share > 0) incident *= left.cosine / left.share;
    lit *= static_cast<float>(left.share);
  }

  // Columns with their weights and tables of the light above a place in them: for `left`.
  struct Table {
    static constexpr int kSteps = 64;
    bool even;                               // not darkened toward the limb
    float half[kColumns], weight[kColumns];  // half its length; share of the disc's light
    // Of the column's light, the share above a place from its lower to its upper end, and the mean of `upward` over the
    // column of what is above.
    float above[kColumns][kSteps + 2], moment[kColumns][kSteps + 2];
  };

 private:
  // Columns of equal width in angle: for facets that two chords bound.
  static constexpr int kFine = 32;
  struct FineColumn {
    double across, half, weight;  // the sum of all weights over all light is 1
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
