#include "engine/sensor/sensor.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/sensor/detector.h"

namespace selenograph::engine {

double expose(const ImageSettings& settings, const std::vector<float>& radiance, std::vector<std::uint16_t>& image) {
  const float brightest = radiance.empty() ? 0.F : *std::max_element(radiance.begin(), radiance.end());
  const double full_scale = settings.full_scale_radiance_w_m2_sr.value_or(static_cast<double>(brightest));
  const double top = settings.bit_depth == 16 ? 65535 : 255;
  image.assign(radiance.size(), 0);
  if (!(full_scale > 0)) return full_scale;
  const double scale = top / full_scale;
  for (std::size_t i = 0; i < radiance.size(); ++i)
    image[i] =
        static_cast<std::uint16_t>(std::clamp(std::nearbyint(static_cast<double>(radiance[i]) * scale), 0.0, top));
  return full_scale;
}

Sensor::Sensor(const FrameRequest& request, const StopToken& stop)
    : request_(request),
      kernel_(request.sensor->optics.point_spread, request.sensor->optics.f_number,
              request.sensor->detector.pixel_pitch_um, request.band->center_um(), stop) {}

double Sensor::full_scale_radiance_w_m2_sr() const {
  const Detector& d = request_.sensor->detector;
  return ((1 << d.bit_depth) - 1 - d.offset_dn) * d.gain_e_dn /
         electrons_per_radiance(request_.sensor->optics, d, request_.band->center_um());
}

void Sensor::image(const View& view, const PixelRays& rays, std::vector<float> radiance,
                   std::vector<std::uint16_t>& image, const StopToken& stop) const {
  const SensorModel& sensor = *request_.sensor;
  vignette(sensor.optics.vignetting, view, rays, radiance, stop);
  const int width = request_.camera.width, height = request_.camera.height;
  if (sensor.optics.point_spread.model != PointSpread::Model::none) {
    std::vector<float> spread;
    kernel_.apply(radiance, width, height, spread, stop);
    radiance.swap(spread);
  }
  detect(sensor, request_.band->center_um(), radiance, width, height, image, stop);
}

Pose moved(const Pose& pose, const Motion& motion, double seconds) {
  const Vec3 turn = motion.angular_rate_deg_s * (kRadiansPerDegree * seconds);
  const double angle = turn.norm();
  Pose later = pose;
  later.position_m += motion.velocity_m_s * seconds;
  // Seen from the camera the Moon turns the other way.
  if (angle > 0)
    later.camera_from_moon = (Eigen::AngleAxisd(-angle, turn / angle) * pose.camera_from_moon).normalized();
  return later;
}

Camera with_margin(Camera camera, int margin_px) {
  camera.width += 2 * margin_px, camera.height += 2 * margin_px;
  camera.cx += margin_px, camera.cy += margin_px;
  return camera;
}

namespace {

// An array that has no margin (the image, which is made without) is left as it is.
template <typename T>
void crop_array(std::vector<T>& array, const Camera& camera, int margin_px) {
  const std::size_t channels =
      array.size() / (static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height));
  if (channels == 0) return;
  const auto margin = static_cast<std::size_t>(margin_px), stride = channels * static_cast<std::size_t>(camera.width),
             row = stride - 2 * margin * channels, rows = static_cast<std::size_t>(camera.height) - 2 * margin;
  for (std::size_t y = 0; y < rows; ++y)
    std::copy_n(array.begin() + static_cast<std::ptrdiff_t>((y + margin) * stride + margin * channels), row,
                array.begin() + static_cast<std::ptrdiff_t>(y * row));
  array.resize(rows * row);
}

}  // namespace

void crop(FrameProducts& products, const Camera& camera, int margin_px) {
  if (margin_px == 0) return;
  std::apply([&](auto&... array) { (crop_array(array, camera, margin_px), ...); }, all_arrays(products));
}

}  // namespace selenograph::engine
