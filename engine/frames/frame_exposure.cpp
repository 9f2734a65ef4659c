#include "engine/frames/frame_exposure.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <utility>

#include "engine/frame/needs.h"
#include "engine/frames/motion_blur.h"
#include "engine/radiometry/spectrum.h"
#include "engine/rays/ray_queries.h"
#include "engine/sky/earth_figure.h"
#include "engine/sky/sky_discs.h"

namespace selenograph::engine {

// For the samples of a moment that is such a share of the exposure.
EachSample FrameExposure::each(float share) const {
  if (share == 0 || !plan_.sensor || !plan_.sensor->wants_samples()) return {};
  return [this, share](const SubpixelSample& sample, const std::vector<float>& radiance) {
    plan_.sensor->add_sample(middle_.views().camera(), middle_.lens(), sample, share, radiance, stop_);
  };
}

EachSample FrameExposure::each_of_middle() const { return each(share_of_middle()); }

void FrameExposure::show_discs(const FrameRequest& request, const std::vector<double>& range_m, float share,
                               std::vector<float>& radiance) {
  if (!wants_discs(request)) return;
  std::vector<float> discs(radiance.size(), 0.F);
  add_discs(request, range_m, terrain_, kept_, stop_, discs);
  std::transform(discs.begin(), discs.end(), radiance.begin(), radiance.begin(), std::plus<>());
  // Their pixels are means already: to the sensor they are one sample at the pixels' centres.
  if (share > 0 && plan_.sensor && plan_.sensor->wants_samples())
    plan_.sensor->add_sample(middle_.views().camera(), middle_.lens(),
                             {.dx = 0, .dy = 0, .store = false, .weight = 1, .light = true, .count = false}, share,
                             std::move(discs), stop_);
}

FrameProducts FrameExposure::draw(const FrameRequest& request, float share, Frame& frame, bool other_moment) {
  FrameMoment moment(request, terrain_, kept_, stop_);
  moment.make_scene(1);
  FrameProducts products;
  moment.draw(0, each(share), products);
  show_discs(request, products.range, share, products.radiance);
  frame.times += moment.times();
  if (other_moment) frame.report.shadow_limits_px.push_back(moment.selection().shadow_limit_px);
  return products;
}

SkyImage FrameExposure::sky_of(const FrameRequest& request, const std::vector<double>& range_m) const {
  return {request, plan_.margin_px(), range_m, terrain_, kept_, stop_};
}

void FrameExposure::add_points(const SkyImage& sky, double share) {
  sky.for_points(plan_.margin_px(),
                 [&](std::span<const LightPoint> some) { plan_.sensor->add_points(some, share, stop_); });
}

// Of the part of the Sun's disc that is beside the frame and that nothing hides, in the middle of the exposure.
void FrameExposure::add_glare() {
  const FrameRequest& request = plan_.request;
  const View& view = middle_.views().reference();
  const Vec3 toward_sun = view.moon_from_camera().transpose() * request.sun.direction;
  const double within_deg = request.sensor->optics.stray_light.sun_within_deg;
  if (!(toward_sun.z() > std::cos(within_deg * kRadiansPerDegree))) return;
  constexpr int kAcross = 9;
  const auto places = places_on_sun(request.sun.direction, sun_radius_deg(request.sun.distance_au), kAcross);
  std::vector<Ray> rays;
  const std::optional<EarthFigure> earth =
      request.sky ? std::optional(earth_of(request, middle_.views())) : std::nullopt;
  for (const Vec3& direction : places) {
    const auto pixel = view.projection().image(view.moon_from_camera().transpose() * direction);
    const bool drawn = pixel && pixel->x >= -0.5 && pixel->y >= -0.5 && pixel->x < request.camera.width - 0.5 &&
                       pixel->y < request.camera.height - 0.5;
    const bool covered = earth && earth->hides(direction, request.sun.distance_au * kAstronomicalUnit_m);
    if (!drawn && !covered) rays.push_back({view.position(), direction});
  }
  constexpr double kDetailWithin_m = 300;  // as wide as the Sun is 3 m there
  const std::vector<HiddenBy> hidden =
      what_hides(rays, request.objects, request.terrain, terrain_, kept_, stop_, kDetailWithin_m);
  const auto free = std::count(hidden.begin(), hidden.end(), HiddenBy::none);
  if (free == 0) return;
  const Band counted = in_photons(*request.band, request.sensor->detector.efficiency);
  const double irradiance_w_m2 = solar_irradiance_w_m2(counted) / (request.sun.distance_au * request.sun.distance_au);
  const auto all = static_cast<double>(places.size());
  plan_.sensor->add_glare(toward_sun, irradiance_w_m2 * static_cast<double>(free) / all, stop_);
}

// Radiance as a mean over the exposure, whose middle is drawn already.
std::vector<float> FrameExposure::mean_of_moments(int moments, const std::vector<float>& in_the_middle, Frame& frame) {
  FrameRequest request = plan_.counted ? *plan_.counted : plan_.request;
  FrameRequest of_points = plan_.request;  // in the band from which the sensor derives its own
  const Pose middle = request.pose;
  request.products = for_radiance(request);
  std::vector<float> mean(in_the_middle.size(), 0.F);
  const float share = 1.F / static_cast<float>(moments);
  const auto add = [&](const std::vector<float>& radiance) {
    for (std::size_t i = 0; i < mean.size(); ++i) mean[i] += share * radiance[i];
  };
  for (const double moment : moments_of(moments, plan_.sensor->integration_time_s())) {
    stop_.check();
    of_points.pose = request.pose = moved(middle, request.sensor->motion, moment);
    const bool drawn = moment == 0 && !plan_.sensor->wants_samples();
    const FrameProducts products = drawn ? FrameProducts() : draw(request, share, frame, true);
    add_points(sky_of(of_points, drawn ? frame.products.range : products.range), static_cast<double>(share));
    add(drawn ? in_the_middle : products.radiance);
  }
  return mean;
}

void FrameExposure::draw_moments(Frame& frame) {
  std::vector<float>& radiance = frame.products.radiance;
  if (radiance.empty()) return;
  frame.report.lit = any_lit(radiance);
  const std::size_t brightest = plan_.sensor ? brightest_pixel(radiance) : 0;
  brightest_w_m2_sr_ = static_cast<double>(radiance[brightest]);
  show_discs(plan_.request, frame.products.range, share_of_middle(), radiance);
  const SkyImage sky = sky_of(plan_.request, frame.products.range);
  if (!plan_.sensor) return sky.add_to(radiance);
  captured_ = plan_.request.products & kRadiance ? radiance : std::exchange(radiance, {});
  if (plan_.counted) {
    captured_ = draw(*plan_.counted, plan_.moving() ? 0.F : 1.F, frame, false).radiance;
    const auto counted_w_m2_sr = static_cast<double>(captured_[brightest]);
    const bool lit = brightest_w_m2_sr_ > 0 && counted_w_m2_sr > 0;
    counted_over_radiance_ = lit ? counted_w_m2_sr / brightest_w_m2_sr_ : plan_.sensor->counted_of_sunlight();
  }
  if (!radiance.empty()) sky.add_to(radiance);
  Sensor& sensor = *plan_.sensor;
  if (const StrayLight& law = plan_.request.sensor->optics.stray_light; law.any())
    sensor.scatter_by(kept_.scattered(law, sensor.camera(), stop_));
  add_points(sky, 1);
  add_glare();
  sensor.choose_integration_time(middle_.views().camera(), middle_.lens(), captured_, stop_);
  if (!plan_.moving()) return;
  sensor.forget_points();
  const double exposure_s = sensor.integration_time_s();
  frame.report.longest_streak_px = plan_.streak_px(exposure_s, middle_.selection(), terrain_, stop_);
  frame.report.motion_samples = motion_samples(plan_.request.sensor->motion, frame.report.longest_streak_px);
  captured_ = mean_of_moments(frame.report.motion_samples, captured_, frame);
}

void FrameExposure::make_image(Frame& frame) {
  const FrameRequest& request = plan_.request;
  FrameReport& report = frame.report;
  std::vector<float>& radiance = frame.products.radiance;
  if (plan_.sensor) {
    capture(frame);
  } else if (request.products & kImage) {
    report.full_scale_radiance_w_m2_sr = expose(request.image, radiance, frame.products.image);
    report.saturated_fraction = share_above(radiance, report.full_scale_radiance_w_m2_sr);
  }
  if (!(request.products & kRadiance)) radiance = {};
}

// The frame was drawn with the sensor's margin, which all products lose.
void FrameExposure::capture(Frame& frame) {
  Sensor& sensor = *plan_.sensor;
  sensor.image(middle_.views().camera(), middle_.lens(), std::move(captured_), frame.products.image, stop_);
  crop(frame.products, plan_.request.camera, sensor.margin_px(), plan_.request.truth.has_value());
  FrameReport& report = frame.report;
  report.integration_time_s = sensor.integration_time_s();
  report.saturated_fraction = sensor.saturated_fraction();
  report.smear_fill = sensor.smear_fill();
  report.brightest_signal_e = sensor.brightest_signal_e();
  report.full_scale_radiance_w_m2_sr = sensor.full_scale_counted_w_m2_sr() / counted_over_radiance_;
  report.margin_px = sensor.margin_px(), report.captured_fraction = sensor.captured();
  if (const StrayLight& law = plan_.request.sensor->optics.stray_light; law.any())
    report.scattered_fraction = ScatteredLight::share(law), report.glare_w_m2_sr = sensor.glare_w_m2_sr();
}

}  // namespace selenograph::engine
