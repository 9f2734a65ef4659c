#include "api/camera_json.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "api/member_kinds.h"
#include "api/ranges.h"

namespace selenograph::api {
namespace {

using engine::Camera;
using engine::Distortion;

const Members<Distortion>& distortion_members() {
  static const auto table = made<Members<Distortion>>(
      "Distortion",
      "Brown-Conrady, OpenCV's coefficients, on the plane z = 1: x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 "
      "(r^2 + 2 x^2), and y' alike.",
      [](auto& m) {
        m.add("model", no_field<Distortion>(), Constant{"brown_conrady"}, "distortion model");
        m.add("k1", &Distortion::k1, Number{kDistortion}, "radial, r^2");
        m.add("k2", &Distortion::k2, Number{kDistortion}, "radial, r^4");
        m.add("k3", &Distortion::k3, Number{kDistortion}, "radial, r^6");
        m.add("p1", &Distortion::p1, Number{kDistortion}, "tangential");
        m.add("p2", &Distortion::p2, Number{kDistortion}, "tangential");
      });
  return *table;
}

std::int64_t largest_side(const Limits& limits) { return limits.max_image_side; }

// Square pixels. fov_deg is the full horizontal angle between the outer edges of the outermost columns.
double focal_length_px(double fov_deg, int width) {
  return 0.5 * width / std::tan(0.5 * fov_deg * std::numbers::pi / 180);
}

std::optional<Camera> resolve_camera(const JsonReader& in, const CameraForm& form, const ReadContext& context) {
  const std::size_t before = in.faults();
  Camera camera{form.width, form.height, 0, 0, 0, 0, form.distortion};
  if (std::int64_t{camera.width} * camera.height > context.limits.max_image_pixels)
    in.fail(fmt::format("{} x {} are more pixels than the {} that this service renders", camera.width, camera.height,
                        context.limits.max_image_pixels));
  camera.fx = form.fov_deg ? focal_length_px(*form.fov_deg, camera.width) : *form.fx;
  camera.fy = form.fy.value_or(camera.fx);
  camera.cx = form.cx.value_or(0.5 * (camera.width - 1));
  camera.cy = form.cy.value_or(0.5 * (camera.height - 1));
  if (!kFocalLength_px.contains(camera.fx))
    in.fail("fov_deg", fmt::format("gives a focal length of {:.3g} px; must be at least {} and at most {} px",
                                   camera.fx, kFocalLength_px.min, kFocalLength_px.max));
  return in.faults() == before ? std::optional(camera) : std::nullopt;
}

CameraForm form_of(const Camera& c) { return {c.width, c.height, {}, c.fx, c.fy, c.cx, c.cy, c.distortion}; }

}  // namespace

const Members<CameraForm, Camera>& camera_members() {
  static const auto table = made<Members<CameraForm, Camera>>(
      "Camera",
      "A pinhole camera, by `fov_deg` or by `fx`, `fy`, `cx`, `cy`. The centre of the top-left pixel is (0, 0). The "
      "service limits width x height, too.",
      [](auto& m) {
        m.add("model", no_field<CameraForm>(), Constant{"pinhole"}, "projection");
        m.add("width", &CameraForm::width, Integer{1, largest_side, "px"}, "columns").required();
        m.add("height", &CameraForm::height, Integer{1, largest_side, "px"}, "rows").required();
        m.add("fov_deg", &CameraForm::fov_deg, Number{kFieldOfView_deg, "deg"},
              "horizontal, full angle: fx = fy = (width/2) / tan(fov/2), principal point in the middle");
        m.add("fx", &CameraForm::fx, Number{kFocalLength_px, "px"}, "focal length");
        m.add("fy", &CameraForm::fy, Number{kFocalLength_px, "px"}, "focal length; default: fx");
        m.add("cx", &CameraForm::cx, Number{kPrincipalPoint_px, "px"}, "principal point; default: (width-1)/2");
        m.add("cy", &CameraForm::cy, Number{kPrincipalPoint_px, "px"}, "principal point; default: (height-1)/2");
        m.add("distortion", &CameraForm::distortion, Object{distortion_members()}, "of the lens; left out: none");
        m.exactly_one({"fov_deg", "fx"});
        m.excludes("fov_deg", {"fy", "cx", "cy"});
        m.resolve(resolve_camera);
        m.unresolve(form_of);
      });
  return *table;
}

}  // namespace selenograph::api
