#include "engine/frames/frame_exposure.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include "engine/frame/needs.h"
#include "engine/frames/frame_drawing.h"
#include "engine/frames/motion_blur.h"
#include "engine/radiometry/spectrum.h"
#include "engine/rays/ray_queries.h"
#include "engine/sky/earth_figure.h"
#include "engine/sky/sky_discs.h"
#include "engine/sky/sky_image.h"
#include "engine/support/stopwatch.h"

namespace selenograph::engine {
namespace {

// Arguments that all steps of an exposure share.
struct Exposing {
  const FramePlan& plan;
  const ExposureMiddle& middle;
  std::optional<Sensor>& sensor;
  const RenderContext& context;

  const Camera& camera() const { return middle.selected.views.camera(); }
};

// Returns the share of the exposure that the drawn middle stands for, if the sensor takes its samples one by one.
float share_of_middle(const FramePlan& plan) { return plan.moving || plan.photon_request ? 0.F : 1.F; }

// Returns a callback that adds each sample of the pixels to the sensor, weighted by its share of the exposure; empty
// for share 0.
EachSample samples_with_share(const ExposureMiddle& middle, std::optional<Sensor>& sensor, float share,
                              const StopToken& stop) {
  if (share == 0 || !sensor || !sensor->wants_samples()) return {};
  return [&middle, &sensor, stop, share](const SubpixelSample& sample, const std::vector<float>& radiance) {
    sensor->add_sample(middle.selected.views.camera(), middle.pixel_rays, sample, share, radiance, stop);
  };
}

// Adds the discs of the Sun and the Earth to the radiance of a request's frame.
void show_discs(const Exposing& exposing, const FrameRequest& request, const std::vector<double>& range_m, float share,
                std::vector<float>& radiance) {
  if (!wants_discs(request)) return;
  const auto& [plan, middle, sensor, context] = exposing;
  std::vector<float> discs(radiance.size(), 0.F);
  add_discs(request, range_m, context, discs);
  std::transform(discs.begin(), discs.end(), radiance.begin(), radiance.begin(), std::plus<>());
  // Pixels of discs are means already: to the sensor they are one sample at the pixels' centres.
  if (share > 0 && sensor && sensor->wants_samples())
    sensor->add_sample(exposing.camera(), middle.pixel_rays,
                       {.dx = 0, .dy = 0, .store = false, .weight = 1, .light = true, .count = false}, share,
                       std::move(discs), context.stop);
}

// Products of one exposure sample beside the middle.
struct ExposureSample {
  FrameProducts products;
  double shadow_limit_px;
  StageTimes times;
};

// Draws the request's radiance at its pose, with the discs of Sun and Earth.
ExposureSample draw_exposure_sample(const Exposing& exposing, const FrameRequest& request, float share) {
  const RenderContext& context = exposing.context;
  const FrameSelection selected = select_frame(request, context);
  FrameScene scene = make_scene(request, selected, 1, context);
  FrameDrawing drawing = draw_frame(request, selected, std::move(scene), 0,
                                    samples_with_share(exposing.middle, exposing.sensor, share, context.stop), context);
  show_discs(exposing, request, drawing.products.range, share, drawing.products.radiance);
  ExposureSample sample{std::move(drawing.products), selected.terrain.shadow_limit_px, selected.times};
  sample.times += drawing.times;
  return sample;
}

// Returns the points of the sky in a request's frame, without those that its ground hides.
SkyImage sky_of(const Exposing& exposing, const FrameRequest& request, const std::vector<double>& range_m) {
  return {request, exposing.plan.margin_px, range_m, exposing.context};
}

// Adds the points of the sky to the sensor, weighted by their share of the exposure.
void add_points(const Exposing& exposing, const SkyImage& sky, double share) {
  sky.for_points(exposing.plan.margin_px, [&](std::span<const LightPoint> points) {
    exposing.sensor->add_points(points, share, exposing.context.stop);
  });
}

// Returns rays toward those of the places on the Sun's disc that are beside the image and not behind the Earth.
std::vector<Ray> rays_to_sun_beside_image(const Exposing& exposing, std::span<const Vec3> places) {
  const FrameRequest& request = exposing.plan.request;
  const RowViews& views = exposing.middle.selected.views;
  const View& view = views.reference();
  const std::optional<EarthFigure> earth = request.sky ? std::optional(earth_of(request, views)) : std::nullopt;
  std::vector<Ray> rays;
  for (const Vec3& direction : places) {
    const auto pixel = view.projection().image(view.moon_from_camera().transpose_times(direction));
    const bool in_image = pixel && pixel->x >= -0.5 && pixel->y >= -0.5 && pixel->x < request.camera.width - 0.5 &&
                          pixel->y < request.camera.height - 0.5;
    const bool covered = earth && earth->hides(direction, request.sun.distance_au * kAstronomicalUnit_m);
    if (!in_image && !covered) rays.push_back({view.position(), direction});
  }
  return rays;
}

// Adds the glare of the Sun: light that the optics scatter from the part of its disc that is outside the image and not
// hidden at mid-exposure.
void add_glare(const Exposing& exposing) {
  const FrameRequest& request = exposing.plan.request;
  const RenderContext& context = exposing.context;
  const View& view = exposing.middle.selected.views.reference();
  const Vec3 toward_sun = view.moon_from_camera().transpose_times(request.sun.direction);
  const double within_deg = request.sensor->optics.stray_light.sun_within_deg;
  if (!(toward_sun.z() > std::cos(within_deg * kRadiansPerDegree))) return;
  constexpr int kAcross = 9;  // points on the Sun's diameter
  const auto directions_to_disc =
      places_on_sun(request.sun.direction, sun_radius_deg(request.sun.distance_au), kAcross);
  const std::vector<Ray> rays = rays_to_sun_beside_image(exposing, directions_to_disc);
  constexpr double kDetailWithin_m = 300;  // farther detail is left out: there the Sun's disc is 3 m wide
  const std::vector<HiddenBy> hidden = what_hides(rays, request.objects, request.terrain, context, kDetailWithin_m);
  const auto free = std::count(hidden.begin(), hidden.end(), HiddenBy::none);
  if (free == 0) return;
  // Weight wavelengths as the detector counts photons; the irradiance stays in W m-2.
  const Band detector_band = in_photons(*request.band, request.sensor->detector.efficiency);
  const double irradiance_w_m2 =
      solar_irradiance_w_m2(detector_band) / (request.sun.distance_au * request.sun.distance_au);
  const auto direction_count = static_cast<double>(directions_to_disc.size());
  exposing.sensor->add_glare(toward_sun, irradiance_w_m2 * static_cast<double>(free) / direction_count, context.stop);
}

// Radiance as the mean over an exposure in motion.
struct ExposureMean {
  std::vector<float> radiance;
  std::vector<double> shadow_limits_px;  // of the samples that were drawn for it
  StageTimes times;
};

// Averages the exposure samples. `radiance`, `range_m`: arrays of the middle, which is drawn already; the other samples
// see their own ground.
ExposureMean mean_over_exposure(const Exposing& exposing, std::span<const double> times_s,
                                const std::vector<float>& radiance, const std::vector<double>& range_m) {
  const auto& [plan, middle, sensor, context] = exposing;
  FrameRequest at_middle = plan.photon_request ? *plan.photon_request : plan.request;
  at_middle.products = for_radiance(at_middle);
  ExposureMean mean;
  mean.radiance.assign(radiance.size(), 0.F);
  const float share = 1.F / static_cast<float>(times_s.size());
  for (const double time_s : times_s) {
    context.stop.check();
    const FrameRequest request = during_exposure(at_middle, time_s);
    // The sky's is in the band from which the sensor derives its own.
    const FrameRequest sky_request = during_exposure(plan.request, time_s);
    std::optional<ExposureSample> sample;
    if (time_s != 0 || sensor->wants_samples()) sample = draw_exposure_sample(exposing, request, share);
    add_points(exposing, sky_of(exposing, sky_request, sample ? sample->products.range : range_m),
               static_cast<double>(share));
    const std::vector<float>& at_time = sample ? sample->products.radiance : radiance;
    for (std::size_t i = 0; i < mean.radiance.size(); ++i) mean.radiance[i] += share * at_time[i];
    if (!sample) continue;
    mean.shadow_limits_px.push_back(sample->shadow_limit_px);
    mean.times += sample->times;
  }
  return mean;
}

// Radiance in the band that the sensor counts, and its ratio to the radiance in the request's band in the brightest
// pixel, whose spectrum stands for all.
struct CountedRadiance {
  std::vector<float> radiance;
  double over_requested = 1;
  StageTimes times;
};

// Draws the frame in the band in which the sensor counts photons. `brightest`: pixel, and its radiance in the request's
// band.
CountedRadiance draw_in_photons(const Exposing& exposing, std::size_t brightest, double brightest_w_m2_sr) {
  const FramePlan& plan = exposing.plan;
  ExposureSample sample = draw_exposure_sample(exposing, *plan.photon_request, plan.moving ? 0.F : 1.F);
  CountedRadiance counted{std::move(sample.products.radiance), 1, sample.times};
  const auto counted_w_m2_sr = static_cast<double>(counted.radiance[brightest]);
  const bool lit = brightest_w_m2_sr > 0 && counted_w_m2_sr > 0;
  counted.over_requested = lit ? counted_w_m2_sr / brightest_w_m2_sr : exposing.sensor->counted_of_sunlight();
  return counted;
}

// Replaces the radiance of a moving exposure by its mean, of as many samples as the image needs.
void average_over_exposure(const Exposing& exposing, CountedRadiance& counted, ExposedFrame& exposed) {
  const auto& [plan, middle, sensor, context] = exposing;
  sensor->forget_points();
  const double span_s = exposure_s(plan.request, sensor->integration_time_s());
  FrameReport& report = exposed.report;
  report.longest_streak_px = longest_streak_px(plan, span_s, middle.selected.terrain, context);
  report.motion_samples = exposure_sample_count(*plan.request.sensor, report.longest_streak_px);
  ExposureMean mean = mean_over_exposure(exposing, exposure_sample_times_s(report.motion_samples, span_s),
                                         counted.radiance, exposed.products.range);
  counted.radiance = std::move(mean.radiance);
  report.shadow_limits_px = std::move(mean.shadow_limits_px);
  exposed.times += mean.times;
}

void report_sensor(const FramePlan& plan, const Sensor& sensor, double counted_over_requested, FrameReport& report) {
  report.integration_time_s = sensor.integration_time_s();
  report.saturated_fraction = sensor.saturated_fraction();
  report.smear_fill = sensor.smear_fill();
  report.brightest_signal_e = sensor.brightest_signal_e();
  report.full_scale_radiance_w_m2_sr = sensor.full_scale_counted_w_m2_sr() / counted_over_requested;
  report.margin_px = plan.margin_px;
  report.captured_fraction = sensor.captured();
  const StrayLight& law = plan.request.sensor->optics.stray_light;
  if (!law.any()) return;
  report.scattered_fraction = ScatteredLight::share(law);
  report.glare_w_m2_sr = sensor.glare_w_m2_sr();
}

// Makes the image by the sensor model (SENSOR++ eqs. 8 and 9) and removes its margin from all products.
void image_by_sensor(const Exposing& exposing, ExposedFrame& exposed) {
  const auto& [plan, middle, sensor, context] = exposing;
  FrameProducts& products = exposed.products;
  std::vector<float>& radiance = products.radiance;
  const std::size_t brightest = brightest_pixel(radiance);
  const auto brightest_w_m2_sr = static_cast<double>(radiance[brightest]);  // without discs and sky
  show_discs(exposing, plan.request, products.range, share_of_middle(plan), radiance);
  CountedRadiance counted;
  {
    const SkyImage sky = sky_of(exposing, plan.request, products.range);
    counted.radiance = plan.request.products & kRadiance ? radiance : std::exchange(radiance, {});
    if (plan.photon_request) {
      counted = draw_in_photons(exposing, brightest, brightest_w_m2_sr);
      exposed.times += counted.times;
    }
    if (!radiance.empty()) sky.add_to(radiance);
    if (const StrayLight& law = plan.request.sensor->optics.stray_light; law.any())
      sensor->scatter_by(context.cache.scattered(law, sensor->camera(), context.stop));
    add_points(exposing, sky, 1);
  }
  add_glare(exposing);
  sensor->choose_integration_time(exposing.camera(), middle.pixel_rays, counted.radiance, context.stop);
  if (plan.moving) average_over_exposure(exposing, counted, exposed);
  sensor->image(exposing.camera(), middle.pixel_rays, std::move(counted.radiance), products.image, context.stop);
  crop(products, plan.request.camera, plan.margin_px, plan.request.truth.has_value());
  report_sensor(plan, *sensor, counted.over_requested, exposed.report);
}

// Makes the image by gain and quantisation alone, if it is requested.
void image_by_gain(const Exposing& exposing, ExposedFrame& exposed) {
  const FrameRequest& request = exposing.plan.request;
  FrameProducts& products = exposed.products;
  show_discs(exposing, request, products.range, share_of_middle(exposing.plan), products.radiance);
  sky_of(exposing, request, products.range).add_to(products.radiance);
  if (!(request.products & kImage)) return;
  FrameReport& report = exposed.report;
  report.full_scale_radiance_w_m2_sr = expose(request.image, products.radiance, products.image);
  report.saturated_fraction = share_above(products.radiance, report.full_scale_radiance_w_m2_sr);
}

}  // namespace

EachSample samples_for_sensor(const FramePlan& plan, const ExposureMiddle& middle, std::optional<Sensor>& sensor,
                              const StopToken& stop) {
  return samples_with_share(middle, sensor, share_of_middle(plan), stop);
}

ExposedFrame expose_frame(const FramePlan& plan, const ExposureMiddle& middle, FrameProducts drawn,
                          std::optional<Sensor>& sensor, const RenderContext& context) {
  Stopwatch watch;
  const Exposing exposing{plan, middle, sensor, context};
  ExposedFrame exposed;
  exposed.products = std::move(drawn);
  if (std::vector<float>& radiance = exposed.products.radiance; !radiance.empty()) {
    exposed.report.lit = any_lit(radiance);
    sensor ? image_by_sensor(exposing, exposed) : image_by_gain(exposing, exposed);
    if (!(plan.request.products & kRadiance)) radiance = {};
  }
  // The other exposure samples have stages of their own, which are not counted twice.
  exposed.times.sensor_ms += watch.lap_ms() - exposed.times.sum_ms();
  return exposed;
}

}  // namespace selenograph::engine
