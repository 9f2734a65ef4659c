#include "engine/frames/frame_plan.h"

#include <cmath>
#include <tuple>
#include <utility>

#include "engine/frame/needs.h"
#include "engine/frames/motion_blur.h"
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

// Craters and the sky are looked for in what each pixel sees: all are drawn, and what was not asked for is removed
// (thin).
FrameRequest with_ranges(FrameRequest request) {
  if (wants_ranges(request)) request.products |= kRange, request.truth.reset();
  return request;
}

// The pixels of a truth grid.
template <typename T>
void thin_array(std::vector<T>& array, const FrameRequest& asked) {
  const auto width = static_cast<std::size_t>(asked.camera.width);
  const std::size_t channels = array.size() / (width * static_cast<std::size_t>(asked.camera.height));
  if (channels == 0) return;
  const TruthGrid& grid = *asked.truth;
  std::vector<T> thinned;
  thinned.reserve(channels * grid.size());
  for (int r = 0; r < grid.rows(); ++r)
    for (int c = 0; c < grid.columns(); ++c) {
      const std::size_t pixel = static_cast<std::size_t>(grid.y + r * grid.every_px) * width +
                                static_cast<std::size_t>(grid.x + c * grid.every_px);
      const auto first = array.begin() + static_cast<std::ptrdiff_t>(channels * pixel);
      thinned.insert(thinned.end(), first, first + static_cast<std::ptrdiff_t>(channels));
    }
  array = std::move(thinned);
}

// Whether all that shines does so in the spectrum that the sensor counts by a factor: sunlight, or the Moon's.
bool in_one_spectrum(const FrameRequest& request, const RadianceTerms& terms, bool emits_elsewhere) {
  const bool sunlight_beside = !request.objects.empty() || (request.sky && (request.sky->sun || request.sky->earth));
  return !request.atmosphere && !terms.emitted && !emits_elsewhere && !(counts_moonlight(request) && sunlight_beside);
}

}  // namespace

void thin(FrameProducts& products, const FrameRequest& asked) {
  if (!(asked.products & kRange)) products.range = {};
  if (!asked.truth) return;
  FrameProducts whole;
  whole.image.swap(products.image), whole.radiance.swap(products.radiance), whole.rock.swap(products.rock);
  std::apply([&](auto&... array) { (thin_array(array, asked), ...); }, all_arrays(products));
  whole.image.swap(products.image), whole.radiance.swap(products.radiance), whole.rock.swap(products.rock);
}

FramePlan::FramePlan(const FrameRequest& asked, const StopToken& stop)
    : sensor(sensor_of(asked, stop)),
      request(with_margin_of(sensor, with_ranges(asked))),
      radiance(radiance_terms(request)),
      emits_elsewhere(objects_emit(request.objects) || !request.temperature_maps.empty()) {
  if (!sensor) return;
  // Light of a spectrum of its own is counted in photons by a frame of its own.
  const auto photons = sensor->photon_band(in_one_spectrum(request, radiance, emits_elsewhere));
  if (!photons) return;
  counted = request;
  counted->band = photons, counted->products = for_radiance(request);
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
