// "camera": a pinhole camera by field of view or by intrinsics.
#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "api/frame_json.h"
#include "api/ranges.h"

namespace selenograph::api {
namespace {

constexpr std::pair<std::string_view, int> kCameraModels[] = {{"pinhole", 0}};
constexpr std::pair<std::string_view, int> kDistortionModels[] = {{"brown_conrady", 0}};

engine::Distortion read_distortion(const JsonReader& in) {
  engine::Distortion d;
  if (!in.object({"model", "k1", "k2", "k3", "p1", "p2"})) return d;
  in.word("model", Words<int>(kDistortionModels), 0);
  d.k1 = in.number("k1", kDistortion, 0);
  d.k2 = in.number("k2", kDistortion, 0);
  d.k3 = in.number("k3", kDistortion, 0);
  d.p1 = in.number("p1", kDistortion, 0);
  d.p2 = in.number("p2", kDistortion, 0);
  return d;
}

// Square pixels. fov_deg is the full horizontal angle between the outer edges of the outermost columns.
double focal_length_px(const JsonReader& in, int width) {
  const double fov_deg = in.number("fov_deg", kFieldOfView_deg);
  if (!kFieldOfView_deg.contains(fov_deg)) return 1;
  const double f = 0.5 * width / std::tan(0.5 * fov_deg * std::numbers::pi / 180);
  if (!kFocalLength_px.contains(f)) {
    in.fail("fov_deg", fmt::format("gives a focal length of {:.3g} px; must be at least {} and at most {} px", f,
                                   kFocalLength_px.min, kFocalLength_px.max));
  }
  return f;
}

void read_intrinsics(const JsonReader& in, engine::Camera& camera) {
  camera.cx = 0.5 * (camera.width - 1);
  camera.cy = 0.5 * (camera.height - 1);
  for (const std::string_view other : {"fx", "fy", "cx", "cy"}) {
    if (!in.has("fov_deg") || !in.has(other)) continue;
    in.alternative({"fov_deg", other}, true);
    return;
  }
  if (in.has("fov_deg")) {
    camera.fx = camera.fy = focal_length_px(in, camera.width);
  } else if (in.has("fx")) {
    camera.fx = in.number("fx", kFocalLength_px);
    camera.fy = in.number("fy", kFocalLength_px, camera.fx);
    camera.cx = in.number("cx", kPrincipalPoint_px, camera.cx);
    camera.cy = in.number("cy", kPrincipalPoint_px, camera.cy);
  } else {
    in.alternative({"fov_deg", "fx"}, true);
  }
}

}  // namespace

engine::Camera read_camera(const JsonReader& in, const Limits& limits) {
  engine::Camera camera;
  if (!in.object({"model", "width", "height", "fov_deg", "fx", "fy", "cx", "cy", "distortion"})) return camera;
  in.word("model", Words<int>(kCameraModels), 0);
  camera.width = static_cast<int>(in.integer("width", 1, limits.max_image_side));
  camera.height = static_cast<int>(in.integer("height", 1, limits.max_image_side));
  if (std::int64_t{camera.width} * camera.height > limits.max_image_pixels) {
    in.fail(fmt::format("{} x {} are more pixels than the {} that this service renders", camera.width, camera.height,
                        limits.max_image_pixels));
  }
  read_intrinsics(in, camera);
  if (in.has("distortion")) camera.distortion = read_distortion(in.at("distortion"));
  return camera;
}

}  // namespace selenograph::api
