#include "engine/frame_exposure.h"

#include <algorithm>
#include <utility>

#include "engine/motion_blur.h"
#include "engine/support/stopwatch.h"

namespace selenograph::engine {

// For the samples of a moment that is such a share of the exposure.
EachSample FrameExposure::each(float share) const {
  if (!plan_.sensor || !plan_.sensor->wants_samples()) return {};
  return [this, share](const SubpixelSample& sample, const std::vector<float>& radiance) {
    plan_.sensor->add_sample(middle_.views().camera(), middle_.lens(), sample, share, radiance, stop_);
  };
}

EachSample FrameExposure::each_of_middle() const { return plan_.moving() || plan_.counted ? EachSample() : each(1); }

std::vector<float> FrameExposure::draw(const FrameRequest& request, const EachSample& each, Frame& frame,
                                       bool other_moment) {
  FrameMoment moment(request, terrain_, kept_, stop_);
  moment.make_scene(1);
  FrameProducts products;
  moment.draw(0, each, products);
  frame.times += moment.times();
  if (other_moment) frame.report.shadow_limits_px.push_back(moment.selection().shadow_limit_px);
  return std::move(products.radiance);
}

// Radiance as a mean over the exposure, whose middle is drawn already.
std::vector<float> FrameExposure::mean_of_moments(int moments, const std::vector<float>& in_the_middle, Frame& frame) {
  FrameRequest request = plan_.counted ? *plan_.counted : plan_.request;
  const Pose middle = request.pose;
  request.products = kRadiance;
  std::vector<float> mean(in_the_middle.size(), 0.F);
  const float share = 1.F / static_cast<float>(moments);
  const auto add = [&](const std::vector<float>& radiance) {
    for (std::size_t i = 0; i < mean.size(); ++i) mean[i] += share * radiance[i];
  };
  for (const double moment : moments_of(moments, plan_.sensor->integration_time_s())) {
    stop_.check();
    if (moment == 0 && !plan_.sensor->wants_samples()) {
      add(in_the_middle);
      continue;
    }
    request.pose = moved(middle, request.sensor->motion, moment);
    add(draw(request, each(share), frame, true));
  }
  return mean;
}

void FrameExposure::draw_moments(Frame& frame) {
  std::vector<float>& radiance = frame.products.radiance;
  if (!radiance.empty())
    frame.report.brightest_w_m2_sr = static_cast<double>(*std::max_element(radiance.begin(), radiance.end()));
  if (!plan_.sensor) return;
  captured_ = plan_.request.products & kRadiance ? radiance : std::exchange(radiance, {});
  if (plan_.counted) captured_ = draw(*plan_.counted, plan_.moving() ? EachSample() : each(1), frame, false);
  Sensor& sensor = *plan_.sensor;
  sensor.choose_integration_time(middle_.views().camera(), middle_.lens(), captured_, stop_);
  if (!plan_.moving()) return;
  const double exposure_s = sensor.integration_time_s();
  frame.report.longest_streak_px = plan_.streak_px(exposure_s, middle_.selection(), terrain_, stop_);
  frame.report.motion_samples = motion_samples(plan_.request.sensor->motion, frame.report.longest_streak_px);
  captured_ = mean_of_moments(frame.report.motion_samples, captured_, frame);
}

void FrameExposure::make_image(Frame& frame) {
  Stopwatch watch;
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
  frame.times.sensor_ms = watch.lap_ms();
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
  report.brightest_signal_e = sensor.signal_e(report.brightest_w_m2_sr);
  report.full_scale_radiance_w_m2_sr = sensor.full_scale_radiance_w_m2_sr();
  report.margin_px = sensor.margin_px(), report.captured_fraction = sensor.captured();
}

}  // namespace selenograph::engine
