// The share of a body's disc above a horizon, at many epochs.
//
//       strips of equal width        Along a strip the light below a height is a cubic of it, which limb darkening
//          _.-|-|-._                 shapes. The horizon is linear between azimuths, and level within a strip.
//        /  | | | |  \     horizon
//   ----|---|-|-|-|---|-.__
//        \__|_|_|_|__/     \___
#pragma once

#include <array>
#include <span>
#include <vector>

#include "engine/horizons/map_horizons.h"

namespace selenograph::engine {

// A body at one epoch: its centre as seen from the Moon's, and its angular radius.
struct BodyEpoch {
  Vec3 direction;  // unit, MOON_ME
  double distance_m;
  double radius_rad;
};

// The epochs of a body as arrays for vectors, which may read past the end of the epochs.
struct BodyTrack {
  explicit BodyTrack(std::span<const BodyEpoch> epochs);

  std::span<const BodyEpoch> epochs;
  std::vector<float> x, y, z;  // of the direction
  std::vector<float> per_m;    // 1 / distance
  std::vector<float> radius_deg;
  double max_radius_rad = 0;
};

// A disc in vertical strips of equal width.
struct Disc {
  static constexpr int kStrips = 12;
  // Position of each strip's middle and half its height, in radii; its share of the disc's light; coefficient l of the
  // cubic (1 - z (l + (1 - l) z^2)) / 2, the share of the strip's light above z, from -1 to 1.
  std::array<float, kStrips> aside, half_height, weight, linear;
};

// Returns the disc with limb darkening 1 - u (1 - mu).
Disc disc_with(double limb_darkening);

// Sets share[epoch * kPacket + lane] to the visible share of the disc's light. A lane without horizons has NaN.
void find_disc_shares(const PacketHorizons& horizons, const Disc& disc, const BodyTrack& track, float* share);

// Sums of shares over epochs, and runs of epochs without light, for each lane. A share of NaN counts as dark.
struct DarkRuns {
  float sum[kPacket] = {}, longest[kPacket] = {}, count[kPacket] = {};
};
// Returns the runs of share[epoch * kPacket + lane].
DarkRuns find_dark_runs(std::span<const float> share);

}  // namespace selenograph::engine
