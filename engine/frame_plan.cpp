#include "engine/frame_plan.h"

#include <cmath>

#include "engine/motion_blur.h"
#include "engine/radiometry/radiometry.h"
#include "engine/visibility/objects/objects_in_frame.h"

namespace selenograph::engine {
namespace {

std::optional<Sensor> sensor_of(const FrameRequest& asked, const StopToken& stop) {
  std::optional<Sensor> sensor;
  if (asked.sensor && asked.products & kImage) sensor.emplace(asked, stop);
  return sensor;
}

// A sensor's model sees a little more than its image shows: rows before the first one, too.
FrameRequest with_margin_of(const std::optional<Sensor>& sensor, FrameRequest request) {
  if (!sensor) return request;
  request.camera = with_margin(request.camera, sensor->margin_px());
  if (request.shutter) request.shutter->first_row -= sensor->margin_px();
  if (request.truth) request.truth->x += sensor->margin_px(), request.truth->y += sensor->margin_px();
  return request;
}

}  // namespace

FramePlan::FramePlan(const FrameRequest& asked, const StopToken& stop)
    : sensor(sensor_of(asked, stop)),
      request(with_margin_of(sensor, asked)),
      radiance(radiance_terms(request)),
      emits_elsewhere(objects_emit(request.objects) || !request.temperature_maps.empty()) {
  if (!sensor) return;
  // Light of a spectrum of its own is counted in photons by a frame of its own.
  const auto photons = sensor->photon_band(!request.atmosphere && !radiance.emitted && !emits_elsewhere);
  if (!photons) return;
  counted = request;
  counted->band = photons, counted->products = kRadiance;
}

double FramePlan::streak_px(double exposure_s, const Selection& selection, const dem::Terrain& terrain,
                            const StopToken& stop) const {
  double ground_m = selection.highest_m;
  if (request.terrain && request.pose.position_m.norm() < kMoonRadius_m + ground_m) {
    const Geographic below = to_geographic(request.pose.position_m);
    const double height_m = terrain.height(below.lat_deg, below.lon_deg, stop).height_m;
    ground_m = std::isnan(height_m) ? double{dem::kLowestRelief_m} : height_m;
  }
  return longest_streak_px(request, exposure_s, ground_m, balls_around(request.objects));
}

int FramePlan::moments(double exposure_s, const Selection& selection, const dem::Terrain& terrain,
                       const StopToken& stop) const {
  if (!moving()) return 1;
  return motion_samples(request.sensor->motion, streak_px(exposure_s, selection, terrain, stop));
}

std::size_t FramePlan::draws(const Selection& selection, const dem::Terrain& terrain, const StopToken& stop) const {
  const double exposure_s = sensor ? sensor->integration_time_s() : 0;
  return static_cast<std::size_t>(moments(exposure_s, selection, terrain, stop)) + (counted ? 1 : 0);
}

}  // namespace selenograph::engine
