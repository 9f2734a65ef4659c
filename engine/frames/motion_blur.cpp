#include "engine/frames/motion_blur.h"

#include <algorithm>
#include <cmath>

#include "engine/camera/view.h"
#include "engine/sensor/sensor.h"

namespace selenograph::engine {
namespace {

// What only turns.
constexpr double kFar_m = 1e9;

// Along a unit direction from outside of the sphere, or from below it: none.
double range_to_sphere(const Vec3& from, const Vec3& direction, double radius) {
  const double closest = -from.dot(direction), inside = radius * radius - (from + closest * direction).squaredNorm();
  const double range = closest - std::sqrt(std::max(0.0, inside));
  return inside > 0 && range > 0 ? range : kFar_m;
}

}  // namespace

double longest_streak_px(const FrameRequest& request, double integration_time_s, double ground_m,
                         std::span<const Ball> objects) {
  const Motion& motion = request.sensor->motion;
  std::vector<View> views;
  for (const double share : {-0.5, 0.0, 0.5})
    views.emplace_back(request.camera, moved(request.pose, motion, share * integration_time_s));
  const View& middle = views[1];
  const Camera& camera = request.camera;
  const double diagonal = std::hypot(camera.width, camera.height);
  double longest = 0;
  const auto follow = [&](const Vec3& place) {
    double way = 0;
    for (std::size_t i = 0; i < 2; ++i) {
      const auto from = views[i].project(place), to = views[i + 1].project(place);
      way += from && to ? std::hypot(to->x - from->x, to->y - from->y) : diagonal;
    }
    longest = std::max(longest, std::min(way, diagonal));
  };
  constexpr int kGrid = 8;
  for (int y = 0; y <= kGrid; ++y)
    for (int x = 0; x <= kGrid; ++x) {
      const auto ray = middle.ray((camera.width - 1) * static_cast<double>(x) / kGrid,
                                  (camera.height - 1) * static_cast<double>(y) / kGrid);
      if (!ray) continue;
      const Vec3 direction = ray->normalized();
      const double range =
          request.terrain ? range_to_sphere(middle.position(), direction, kMoonRadius_m + ground_m) : kFar_m;
      follow(middle.position() + range * direction);
    }
  for (const Ball& ball : objects) {
    if (!middle.may_see(ball.centre_m, ball.radius_m)) continue;
    const Vec3 toward = ball.centre_m - middle.position();
    const double distance = toward.norm(), nearest = std::max(distance - ball.radius_m, 0.01 * distance);
    if (distance > 0) follow(middle.position() + toward * (nearest / distance));
  }
  return longest;
}

int motion_samples(const Motion& motion, double longest_streak_px) {
  if (motion.samples) return *motion.samples;
  const int pixels = static_cast<int>(std::ceil(std::min(longest_streak_px, double{Motion::kMaxMoments})));
  return std::clamp(pixels | 1, 1, Motion::kMaxMoments);
}

std::vector<double> moments_of(int samples, double integration_time_s) {
  std::vector<double> moments;
  moments.reserve(static_cast<std::size_t>(samples));
  for (int k = 0; k < samples; ++k) moments.push_back(((k + 0.5) / samples - 0.5) * integration_time_s);
  return moments;
}

}  // namespace selenograph::engine
