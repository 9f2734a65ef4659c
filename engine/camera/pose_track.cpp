#include "engine/camera/pose_track.h"

#include <algorithm>
#include <utility>

namespace selenograph::engine {
namespace {

// Returns the velocity of the parabola through three positions, at the middle one.
Vec3 middle_velocity(const PoseAtTime& a, const PoseAtTime& b, const PoseAtTime& c) {
  const double before = b.time_s - a.time_s, after = c.time_s - b.time_s;
  const Vec3 arrival = (b.pose.position_m - a.pose.position_m) / before,
             departure = (c.pose.position_m - b.pose.position_m) / after;
  return (after * arrival + before * departure) / (before + after);
}

// Returns the velocities at the poses.
std::vector<Vec3> velocities(const std::vector<PoseAtTime>& poses) {
  const std::size_t n = poses.size();
  const auto mean = [&](std::size_t i) -> Vec3 {
    return (poses[i + 1].pose.position_m - poses[i].pose.position_m) / (poses[i + 1].time_s - poses[i].time_s);
  };
  if (n == 2) return {mean(0), mean(0)};
  std::vector<Vec3> out(n);
  for (std::size_t i = 1; i + 1 < n; ++i) out[i] = middle_velocity(poses[i - 1], poses[i], poses[i + 1]);
  // A parabola's mean velocity between two times is the mean of its velocities at them.
  out[0] = 2 * mean(0) - out[1];
  out[n - 1] = 2 * mean(n - 2) - out[n - 2];
  return out;
}

}  // namespace

PoseTrack::PoseTrack(const Pose& start, const Rates& rates, std::vector<PoseAtTime> poses)
    : start_(start), rates_(rates), poses_(std::move(poses)) {
  if (poses_.empty()) return;
  velocities_ = velocities(poses_);
  for (std::size_t i = 0; i + 1 < poses_.size(); ++i)
    turns_.emplace_back(poses_[i + 1].pose.camera_from_moon * poses_[i].pose.camera_from_moon.conjugate());
}

// Returns the segment between two poses at a time; the first or last one outside all poses.
std::size_t PoseTrack::segment_of(double seconds) const {
  const auto later = std::upper_bound(poses_.begin(), poses_.end(), seconds,
                                      [](double t, const PoseAtTime& p) { return t < p.time_s; });
  const auto past = static_cast<std::size_t>(later - poses_.begin());
  return std::clamp<std::size_t>(past, 1, poses_.size() - 1) - 1;
}

Rates PoseTrack::rates_at(double seconds) const {
  if (poses_.empty()) return rates_;
  const std::size_t segment = segment_of(seconds);
  const double length_s = poses_[segment + 1].time_s - poses_[segment].time_s;
  // A turn takes camera axes to later ones; from the camera, the Moon turns the opposite direction (moved()).
  const AngleAxis& turn = turns_[segment];
  return {-turn.angle_rad / kRadiansPerDegree / length_s * turn.axis, velocity_at(segment, seconds)};
}

Pose PoseTrack::at(double seconds) const {
  if (poses_.empty()) return moved(start_, rates_, seconds);
  const std::size_t segment = segment_of(seconds);
  const PoseAtTime& from = poses_[segment];
  const double share = (seconds - from.time_s) / (poses_[segment + 1].time_s - from.time_s);
  const AngleAxis& turn = turns_[segment];
  Pose pose{position_at(segment, seconds), from.pose.camera_from_moon};
  if (turn.angle_rad != 0)
    pose.camera_from_moon = (AngleAxis(share * turn.angle_rad, turn.axis) * pose.camera_from_moon).normalized();
  return pose;
}

// Evaluates the cubic Hermite polynomial of a segment; beyond the ends the camera moves on at constant velocity.
Vec3 PoseTrack::position_at(std::size_t segment, double seconds) const {
  const PoseAtTime &a = poses_[segment], &b = poses_[segment + 1];
  if (seconds < a.time_s) return a.pose.position_m + (seconds - a.time_s) * velocities_[segment];
  if (seconds > b.time_s) return b.pose.position_m + (seconds - b.time_s) * velocities_[segment + 1];
  const double length = b.time_s - a.time_s, s = (seconds - a.time_s) / length;
  // Evaluate relative to one end: the polynomial then rounds like the path's length, not like the distance from the
  // Moon.
  const Vec3 path = b.pose.position_m - a.pose.position_m;
  return a.pose.position_m + s * s * (3 - 2 * s) * path +
         length * s * (1 - s) * ((1 - s) * velocities_[segment] - s * velocities_[segment + 1]);
}

// Returns the derivative of position_at().
Vec3 PoseTrack::velocity_at(std::size_t segment, double seconds) const {
  const PoseAtTime &a = poses_[segment], &b = poses_[segment + 1];
  if (seconds < a.time_s) return velocities_[segment];
  if (seconds > b.time_s) return velocities_[segment + 1];
  const double length = b.time_s - a.time_s, s = (seconds - a.time_s) / length;
  const Vec3 path = b.pose.position_m - a.pose.position_m;
  return 6 * s * (1 - s) / length * path + (1 - s) * (1 - 3 * s) * velocities_[segment] +
         s * (3 * s - 2) * velocities_[segment + 1];
}

}  // namespace selenograph::engine
