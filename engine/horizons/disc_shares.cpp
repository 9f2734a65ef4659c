#include "engine/horizons/disc_shares.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "dem/base/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/horizons/disc_shares.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "engine/support/lane_angles.h"

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using DiscLanes = hn::CappedTag<float, kPacket>;
using DiscVector = hn::Vec<DiscLanes>;
inline constexpr int kDiscLanes = static_cast<int>(HWY_MIN(HWY_LANES(float), kPacket));

// Local axes of the lanes in MOON_ME, and their distances from the Moon's centre.
struct alignas(64) LaneFrames {
  float east[3][kPacket], north[3][kPacket], up[3][kPacket], radius_m[kPacket];
};

// Position of a body in the sky of a place: azimuth in steps of the horizons' azimuths, elevation in degrees.
struct LocalPosition {
  DiscVector azimuth_steps, elevation_deg;
};

HWY_INLINE DiscVector Dot(DiscLanes d, const float (*axis)[kPacket], int i, const float* v) {
  const DiscVector x = hn::Mul(hn::Load(d, axis[0] + i), hn::Set(d, v[0]));
  const DiscVector y = hn::Mul(hn::Load(d, axis[1] + i), hn::Set(d, v[1]));
  return hn::Add(hn::Add(x, y), hn::Mul(hn::Load(d, axis[2] + i), hn::Set(d, v[2])));
}

// Converts east, north and up components to azimuth and elevation.
HWY_INLINE LocalPosition PositionOf(DiscLanes d, DiscVector east, DiscVector north, DiscVector up,
                                    float steps_per_rad) {
  const DiscVector level = hn::Sqrt(hn::Add(hn::Mul(east, east), hn::Mul(north, north)));
  const DiscVector elevation = Arctangent(d, hn::Div(up, hn::Max(level, hn::Set(d, 1e-6F))));
  return {hn::Mul(AngleOf(d, north, east), hn::Set(d, steps_per_rad)),
          hn::Mul(elevation, hn::Set(d, static_cast<float>(kDegreesPerRadian)))};
}

// Shares of one packet at all epochs.
class PacketShares {
 public:
  PacketShares(const PacketHorizons& horizons, const Disc& disc, const BodyTrack& track)
      : horizons_(horizons), disc_(disc), track_(track), epochs_(track.epochs) {
    const int first = static_cast<int>(
        std::find_if(horizons.index, horizons.index + kPacket, [](int i) { return i >= 0; }) - horizons.index);
    for (int i = 0; i < kPacket; ++i) {
      const int lane = horizons.index[i] >= 0 ? i : first;
      for (int axis = 0; axis < 3; ++axis) {
        frames_.east[axis][i] = static_cast<float>(horizons.axes[lane].east[axis]);
        frames_.north[axis][i] = static_cast<float>(horizons.axes[lane].north[axis]);
        frames_.up[axis][i] = static_cast<float>(horizons.axes[lane].up[axis]);
      }
      frames_.radius_m[i] = static_cast<float>(horizons.radius_m[lane]);
    }
    bound_lanes(first);
    bound_horizons();
  }

  void find(float* share) const {
    for (std::size_t e = 0; e < epochs_.size(); e += kDiscLanes) find_group(e, share);
    for (int i = 0; i < kPacket; ++i)
      if (horizons_.index[i] < 0)
        for (std::size_t e = 0; e < epochs_.size(); ++e)
          share[e * kPacket + static_cast<std::size_t>(i)] = std::numeric_limits<float>::quiet_NaN();
  }

 private:
  // Sets the largest angles between a lane's axes and the first lane's: of the vertical, and of north.
  void bound_lanes(int first) {
    const EastNorthUp& axes = horizons_.axes[first];
    for (int i = 0; i < kPacket; ++i) {
      if (horizons_.index[i] < 0) continue;
      tilt_rad_ = std::max(tilt_rad_, (horizons_.axes[i].up - axes.up).norm());
      turn_rad_ = std::max(turn_rad_, (horizons_.axes[i].north - axes.north).norm());
    }
    first_ = first;
  }

  // Sets the lowest and the highest horizon of all lanes at each azimuth and its neighbours.
  void bound_horizons() {
    const auto azimuths = static_cast<std::size_t>(horizons_.azimuths);
    std::vector<float> low(azimuths), high(azimuths);
    for (std::size_t a = 0; a < azimuths; ++a) {
      low[a] = std::numeric_limits<float>::infinity();
      high[a] = -low[a];
      for (std::size_t i = 0; i < kPacket; ++i) {
        const float h = horizons_.elevation_deg[a * kPacket + i];
        if (horizons_.index[i] < 0) continue;
        // A horizon without data bounds nothing: it makes the lane's share NaN.
        low[a] = std::isnan(h) ? -std::numeric_limits<float>::infinity() : std::min(low[a], h);
        high[a] = std::isnan(h) ? std::numeric_limits<float>::infinity() : std::max(high[a], h);
      }
    }
    const double steps_per_rad = horizons_.azimuths / (2 * std::numbers::pi);
    const double reach =
        (track_.max_radius_rad / std::cos(kSteep_deg * kRadiansPerDegree) + 2 * turn_rad_) * steps_per_rad + 2;
    const int steps = static_cast<int>(std::min<double>(reach, horizons_.azimuths));
    low_ = low;
    high_ = high;
    for (int a = 0; a < horizons_.azimuths; ++a)
      for (int k = -steps; k <= steps; ++k) {
        const auto from = static_cast<std::size_t>((a + k + 2 * horizons_.azimuths) % horizons_.azimuths);
        low_[static_cast<std::size_t>(a)] = std::min(low_[static_cast<std::size_t>(a)], low[from]);
        high_[static_cast<std::size_t>(a)] = std::max(high_[static_cast<std::size_t>(a)], high[from]);
      }
  }

  // Sets the shares at kDiscLanes epochs: 0 or 1 where the disc is below or above all horizons near its azimuth.
  void find_group(std::size_t first, float* share) const {
    const DiscLanes d;
    const hn::Rebind<std::int32_t, DiscLanes> di;
    const EastNorthUp& axes = horizons_.axes[first_];
    const DiscVector x = hn::LoadU(d, &track_.x[first]), y = hn::LoadU(d, &track_.y[first]),
                     z = hn::LoadU(d, &track_.z[first]);
    const auto along = [&](const Vec3& axis) {
      const auto component = [&](int i, DiscVector v) { return hn::Mul(hn::Set(d, static_cast<float>(axis[i])), v); };
      return hn::Add(hn::Add(component(0, x), component(1, y)), component(2, z));
    };
    const DiscVector parallax =
        hn::Mul(hn::Set(d, static_cast<float>(horizons_.radius_m[first_])), hn::LoadU(d, &track_.per_m[first]));
    const auto steps_per_rad = static_cast<float>(horizons_.azimuths / (2 * std::numbers::pi));
    const LocalPosition body =
        PositionOf(d, along(axes.east), along(axes.north), hn::Sub(along(axes.up), parallax), steps_per_rad);
    // The bounds include neighbouring azimuths, so that rounding to one of them does no harm.
    const auto azimuth = hn::Min(hn::ConvertTo(di, body.azimuth_steps), hn::Set(di, horizons_.azimuths - 1));
    constexpr double kMargin_deg = 0.001;
    const DiscVector radius = hn::Add(hn::LoadU(d, &track_.radius_deg[first]),
                                      hn::Set(d, static_cast<float>(tilt_rad_ * kDegreesPerRadian + kMargin_deg)));
    const auto is_level = hn::Lt(hn::Abs(body.elevation_deg), hn::Set(d, static_cast<float>(kSteep_deg)));
    const auto is_lit =
        hn::And(is_level, hn::Gt(hn::Sub(body.elevation_deg, radius), hn::GatherIndex(d, high_.data(), azimuth)));
    const auto is_dark =
        hn::And(is_level, hn::Lt(hn::Add(body.elevation_deg, radius), hn::GatherIndex(d, low_.data(), azimuth)));
    constexpr float kPartly = -1;
    alignas(64) float uniform_share[kPacket];
    hn::Store(hn::IfThenElse(is_lit, hn::Set(d, 1.F), hn::IfThenElse(is_dark, hn::Zero(d), hn::Set(d, kPartly))), d,
              uniform_share);
    const std::size_t count = std::min<std::size_t>(kDiscLanes, epochs_.size() - first);
    for (std::size_t i = 0; i < count; ++i) {
      float* out = share + (first + i) * kPacket;
      if (uniform_share[i] == kPartly)
        find_partly(epochs_[first + i], out);
      else
        std::fill(out, out + kPacket, uniform_share[i]);
    }
  }

  // Sets the shares by strips.
  void find_partly(const BodyEpoch& epoch, float* share) const {
    const DiscLanes d;
    const float direction[3] = {static_cast<float>(epoch.direction.x()), static_cast<float>(epoch.direction.y()),
                                static_cast<float>(epoch.direction.z())};
    const auto steps_per_rad = static_cast<float>(horizons_.azimuths / (2 * std::numbers::pi));
    const auto radius_deg = static_cast<float>(epoch.radius_rad * kDegreesPerRadian);
    const DiscVector unity = hn::Set(d, 1.F), half = hn::Set(d, 0.5F);
    for (int i = 0; i < kPacket; i += kDiscLanes) {
      const DiscVector parallax =
          hn::Mul(hn::Load(d, frames_.radius_m + i), hn::Set(d, static_cast<float>(1 / epoch.distance_m)));
      const DiscVector east = Dot(d, frames_.east, i, direction), north = Dot(d, frames_.north, i, direction);
      const DiscVector up = hn::Sub(Dot(d, frames_.up, i, direction), parallax);
      const LocalPosition body = PositionOf(d, east, north, up, steps_per_rad);
      // A strip lies aside by its offset over the cosine of the elevation, at most by half a turn.
      const DiscVector level = hn::Sqrt(hn::Add(hn::Mul(east, east), hn::Mul(north, north)));
      const DiscVector steps_per_radius = hn::Min(
          hn::Div(hn::Set(d, static_cast<float>(epoch.radius_rad) * steps_per_rad), hn::Max(level, hn::Set(d, 1e-4F))),
          hn::Set(d, 0.5F * static_cast<float>(horizons_.azimuths)));
      DiscVector sum = hn::Zero(d);
      for (int strip = 0; strip < Disc::kStrips; ++strip) {
        const auto s = static_cast<std::size_t>(strip);
        const DiscVector horizon =
            HorizonAt(d, i, hn::Add(body.azimuth_steps, hn::Mul(hn::Set(d, disc_.aside[s]), steps_per_radius)));
        const DiscVector z = hn::Div(hn::Sub(horizon, body.elevation_deg),
                                     hn::Set(d, std::max(radius_deg, 1e-6F) * disc_.half_height[s]));
        const DiscVector inside = hn::Max(hn::Neg(unity), hn::Min(unity, z));
        const DiscVector linear = hn::Set(d, disc_.linear[s]);
        const DiscVector cubic =
            hn::Mul(inside, hn::Add(linear, hn::Mul(hn::Sub(unity, linear), hn::Mul(inside, inside))));
        const DiscVector light = hn::Mul(hn::Mul(hn::Set(d, disc_.weight[s]), half), hn::Sub(unity, cubic));
        // A horizon without data makes the share NaN: keep it from the vector's minimum, which may drop it.
        sum = hn::Add(sum, hn::IfThenElse(hn::Eq(horizon, horizon), light, horizon));
      }
      hn::StoreU(hn::IfThenElse(hn::Eq(sum, sum), hn::Max(hn::Zero(d), hn::Min(unity, sum)), sum), d, share + i);
    }
  }

  // Returns the lanes' horizons at fractional azimuths, in steps from -azimuths / 2 to 3 / 2 azimuths, degrees.
  HWY_INLINE DiscVector HorizonAt(DiscLanes d, int first_lane, DiscVector steps) const {
    const hn::Rebind<std::int32_t, DiscLanes> di;
    const DiscVector turn = hn::Set(d, static_cast<float>(horizons_.azimuths));
    const DiscVector positive = hn::IfThenElse(hn::Lt(steps, hn::Zero(d)), hn::Add(steps, turn), steps);
    const DiscVector wrapped = hn::IfThenElse(hn::Ge(positive, turn), hn::Sub(positive, turn), positive);
    const auto last = hn::Set(di, horizons_.azimuths - 1);
    const auto from = hn::Min(hn::ConvertTo(di, wrapped), last);
    const auto next = hn::IfThenElse(hn::Eq(from, last), hn::Zero(di), hn::Add(from, hn::Set(di, 1)));
    const auto lane = hn::Iota(di, first_lane);
    const auto element = [&](auto azimuth) { return hn::Add(hn::ShiftLeft<4>(azimuth), lane); };
    static_assert(kPacket == 16);
    const float* elevations = horizons_.elevation_deg.data();
    DiscVector a, b;
    if (const auto common = hn::GetLane(from); hn::AllTrue(di, hn::Eq(from, hn::Set(di, common)))) {
      a = hn::LoadU(d, elevations + common * kPacket + first_lane);
      b = hn::LoadU(d, elevations + hn::GetLane(next) * kPacket + first_lane);
    } else {
      a = hn::GatherIndex(d, elevations, element(from));
      b = hn::GatherIndex(d, elevations, element(next));
    }
    return hn::Add(a, hn::Mul(hn::Sub(wrapped, hn::ConvertTo(d, from)), hn::Sub(b, a)));
  }

  static constexpr double kSteep_deg = 60;  // above it azimuths of a disc's sides differ too much for the bounds

  const PacketHorizons& horizons_;
  const Disc& disc_;
  const BodyTrack& track_;
  std::span<const BodyEpoch> epochs_;
  LaneFrames frames_;
  int first_ = 0;
  double tilt_rad_ = 0, turn_rad_ = 0;
  std::vector<float> low_, high_;
};

// Implements find_disc_shares().
void FindDiscShares(const PacketHorizons& horizons, const Disc& disc, const BodyTrack& track, float* share) {
  PacketShares(horizons, disc, track).find(share);
}

// Implements find_dark_runs().
DarkRuns FindDarkRuns(std::span<const float> share) {
  const DiscLanes d;
  DarkRuns runs;
  const DiscVector zero = hn::Zero(d), unity = hn::Set(d, 1.F);
  for (int i = 0; i < kPacket; i += kDiscLanes) {
    DiscVector sum = zero, length = zero, longest = zero, count = zero;
    for (std::size_t e = static_cast<std::size_t>(i); e < share.size(); e += kPacket) {
      const DiscVector value = hn::LoadU(d, &share[e]);
      sum = hn::Add(sum, value);
      length = hn::IfThenElse(hn::Gt(value, zero), zero, hn::Add(length, unity));
      count = hn::Add(count, hn::IfThenElseZero(hn::Eq(length, unity), unity));
      longest = hn::Max(longest, length);
    }
    hn::StoreU(sum, d, runs.sum + i);
    hn::StoreU(longest, d, runs.longest + i);
    hn::StoreU(count, d, runs.count + i);
  }
  return runs;
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

Disc disc_with(double limb_darkening) {
  Disc disc;
  double all_light = 0;
  std::array<double, Disc::kStrips> strip_light{};
  for (std::size_t s = 0; s < Disc::kStrips; ++s) {
    constexpr int kSamples = 200;  // across the strip, and along half of it
    const double width = 2.0 / Disc::kStrips, middle = (static_cast<double>(s) + 0.5) * width - 1;
    double half_height = 0;
    for (int k = 0; k < kSamples; ++k) {
      const double x = middle + ((k + 0.5) / kSamples - 0.5) * width;
      half_height += std::sqrt(1 - x * x) / kSamples;
    }
    // Fit the cubic to the light between the middle and half of the strip's height.
    double light = 0, inner_light = 0;
    for (int k = 0; k < kSamples; ++k) {
      const double z = (k + 0.5) / kSamples * half_height, mu_square = std::max(0.0, 1 - z * z - middle * middle);
      const double radiance = 1 - limb_darkening * (1 - std::sqrt(mu_square));
      light += radiance;
      if (2 * k < kSamples) inner_light += radiance;
    }
    disc.aside[s] = static_cast<float>(middle);
    disc.half_height[s] = static_cast<float>(half_height);
    // At z = 1/2 the cubic is l / 2 + (1 - l) / 8.
    disc.linear[s] = static_cast<float>((inner_light / light - 0.125) / 0.375);
    strip_light[s] = light / kSamples * half_height;
    all_light += strip_light[s];
  }
  for (std::size_t s = 0; s < Disc::kStrips; ++s) disc.weight[s] = static_cast<float>(strip_light[s] / all_light);
  return disc;
}

BodyTrack::BodyTrack(std::span<const BodyEpoch> at) : epochs(at) {
  for (std::vector<float>* values : {&x, &y, &z, &per_m, &radius_deg}) values->resize(epochs.size() + kPacket);
  for (std::size_t e = 0; e < epochs.size(); ++e) {
    const BodyEpoch& epoch = epochs[e];
    x[e] = static_cast<float>(epoch.direction.x());
    y[e] = static_cast<float>(epoch.direction.y());
    z[e] = static_cast<float>(epoch.direction.z());
    per_m[e] = static_cast<float>(1 / epoch.distance_m);
    radius_deg[e] = static_cast<float>(epoch.radius_rad * kDegreesPerRadian);
    max_radius_rad = std::max(max_radius_rad, epoch.radius_rad);
  }
}

HWY_EXPORT(FindDiscShares);
HWY_EXPORT(FindDarkRuns);

void find_disc_shares(const PacketHorizons& horizons, const Disc& disc, const BodyTrack& track, float* share) {
  HWY_DYNAMIC_DISPATCH(FindDiscShares)(horizons, disc, track, share);
}

DarkRuns find_dark_runs(std::span<const float> share) { return HWY_DYNAMIC_DISPATCH(FindDarkRuns)(share); }

}  // namespace selenograph::engine
#endif
