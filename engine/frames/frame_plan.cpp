#include "engine/frames/frame_plan.h"

#include <cstddef>
#include <tuple>
#include <utility>
#include <vector>

#include "engine/frame/needs.h"
#include "engine/radiometry/radiometry.h"
#include "engine/visibility/objects/objects_in_frame.h"

namespace selenograph::engine {
namespace {

// A sensor sees a little more than its image shows, and with a shutter also rows before the first.
FrameRequest add_margin(FrameRequest request, int margin_px) {
  request.camera = with_margin(request.camera, margin_px);
  if (request.shutter) request.shutter->first_row -= margin_px;
  if (request.truth) {
    request.truth->x += margin_px;
    request.truth->y += margin_px;
  }
  return request;
}

// Craters and the sky are searched for in the ranges of all pixels; keep_requested removes those later.
FrameRequest add_ranges(FrameRequest request) {
  if (wants_ranges(request)) {
    request.products |= kRange;
    request.truth.reset();
  }
  return request;
}

// Replaces an array of all pixels by that of a truth grid.
template <typename T>
void subsample(std::vector<T>& array, const FrameRequest& request) {
  const auto width = static_cast<std::size_t>(request.camera.width);
  const std::size_t channels = array.size() / (width * static_cast<std::size_t>(request.camera.height));
  if (channels == 0) return;
  const TruthGrid& grid = *request.truth;
  std::vector<T> subsampled;
  subsampled.reserve(channels * grid.size());
  for (int r = 0; r < grid.rows(); ++r)
    for (int c = 0; c < grid.columns(); ++c) {
      const std::size_t pixel = static_cast<std::size_t>(grid.y + r * grid.every_px) * width +
                                static_cast<std::size_t>(grid.x + c * grid.every_px);
      const auto first = array.begin() + static_cast<std::ptrdiff_t>(channels * pixel);
      subsampled.insert(subsampled.end(), first, first + static_cast<std::ptrdiff_t>(channels));
    }
  array = std::move(subsampled);
}

// Returns whether all light has the spectrum that the sensor counts by a factor: the Sun's, or the Moon's.
bool has_one_spectrum(const FramePlan& plan) {
  const FrameRequest& request = plan.request;
  const bool shows_sunlight = !request.objects.empty() || (request.sky && (request.sky->sun || request.sky->earth));
  return !request.atmosphere && !plan.radiance.emitted && !plan.emits_elsewhere &&
         !(counts_moonlight(request) && shows_sunlight);
}

// Exchanges the products that a truth grid does not apply to.
void swap_whole_image(FrameProducts& a, FrameProducts& b) {
  a.image.swap(b.image);
  a.radiance.swap(b.radiance);
  a.rock.swap(b.rock);
}

}  // namespace

void keep_requested(FrameProducts& products, const FrameRequest& request) {
  if (!(request.products & kRange)) products.range = {};
  if (!request.truth) return;
  FrameProducts whole_image;
  swap_whole_image(products, whole_image);
  std::apply([&](auto&... array) { (subsample(array, request), ...); }, all_arrays(products));
  swap_whole_image(products, whole_image);
}

std::optional<Sensor> make_sensor(const FrameRequest& request, const StopToken& stop) {
  std::optional<Sensor> sensor;
  if (request.sensor && request.products & kImage) sensor.emplace(request, stop);
  return sensor;
}

FramePlan plan_frame(const FrameRequest& request, std::optional<Sensor>& sensor) {
  FramePlan plan;
  plan.margin_px = sensor ? sensor->margin_px() : 0;
  plan.request = add_margin(add_ranges(request), plan.margin_px);
  plan.moving = sensor && !(request.sensor->motion.none() && request.sensor->tdi.none());
  plan.radiance = radiance_terms(plan.request);
  plan.emits_elsewhere = objects_emit(request.objects) || !request.temperature_maps.empty();
  if (!sensor) return plan;
  // Light of another spectrum is counted in photons, by a frame in a band of its own.
  if (const auto photons = sensor->photon_band(has_one_spectrum(plan))) {
    plan.photon_request = plan.request;
    plan.photon_request->band = photons;
    plan.photon_request->products = for_radiance(plan.request);
  }
  return plan;
}

}  // namespace selenograph::engine
