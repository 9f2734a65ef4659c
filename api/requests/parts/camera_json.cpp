// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/parts/camera_json.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "api/json/ranges.h"
#include "api/schema/member_kinds.h"
#include "dem/grid/geodesy.h"
#include "engine/camera/fisheye.h"

namespace selenograph::api {
namespace {

using engine::Camera;
using engine::CameraModel;

constexpr std::pair<std::string_view, CameraModel> kCameraModels[] = {
    {"pinhole", CameraModel::pinhole},
    {"fisheye", CameraModel::fisheye},
};
// Limit on the columns and rows of a camera in any call. Calls that render have a lower limit (check_rendered_size).
constexpr std::int64_t kMaxSide = 65535;
// Distortion models: each belongs to one camera model.
constexpr std::pair<std::string_view, CameraModel> kDistortions[] = {
    {"brown_conrady", CameraModel::pinhole},
    {"kannala_brandt", CameraModel::fisheye},
};

const Members<DistortionForm>& distortion_members() {
  static const auto table = make_table<Members<DistortionForm>>(
      "Distortion",
      "Pinhole: Brown-Conrady with OpenCV's coefficients, on the plane z = 1: x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + "
      "2 p1 x y + p2 (r^2 + 2 x^2), and y' accordingly. Fisheye: Kannala-Brandt, as in OpenCV's fisheye module: radius "
      "= theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8), theta: angle from the boresight in radians.",
      [](auto& m) {
        m.add("model", &DistortionForm::model, Word{kDistortions}, "distortion model");
        m.add("k1", &DistortionForm::k1, Number{kDistortion}, "radial, r^2 or theta^2");
        m.add("k2", &DistortionForm::k2, Number{kDistortion}, "radial, r^4 or theta^4");
        m.add("k3", &DistortionForm::k3, Number{kDistortion}, "radial, r^6 or theta^6");
        m.add("k4", &DistortionForm::k4, Number{kDistortion}, "radial, theta^8").only_for({"kannala_brandt"});
        m.add("p1", &DistortionForm::p1, Number{kDistortion}, "tangential").only_for({"brown_conrady"});
        m.add("p2", &DistortionForm::p2, Number{kDistortion}, "tangential").only_for({"brown_conrady"});
        m.set_model("model");
      });
  return *table;
}

// Returns the focal length for square pixels. fov_deg is the full horizontal angle between the outer edges of the
// outermost columns, half of which is imaged at half the width: f tan(fov / 2) of a pinhole, f radius(fov / 2) of a
// fisheye.
double focal_length_px(const Camera& camera, double fov_deg) {
  if (camera.model == CameraModel::pinhole)
    return 0.5 * camera.width / std::tan(0.5 * fov_deg * std::numbers::pi / 180);
  return 0.5 * camera.width / engine::Fisheye(camera.fisheye).radius(0.5 * fov_deg * kRadiansPerDegree);
}

// Reports a field of view that the camera's model cannot image.
void check_field_of_view(const JsonReader& in, const Camera& camera, double fov_deg) {
  if (camera.model == CameraModel::pinhole && !kFieldOfView_deg.contains(fov_deg))
    return in.fail("fov_deg", fmt::format("must be below {} of a pinhole", kFieldOfView_deg.max));
  // A fisheye (the models beyond the plane z = 1) images only the angles to which its distortion gives a radius.
  if (camera.beyond_plane()) {
    const double widest_deg = 2 * kDegreesPerRadian * engine::Fisheye(camera.fisheye).limit();
    if (fov_deg > widest_deg)
      in.fail("fov_deg", fmt::format("is wider than the distortion images: {:.6g} degrees", widest_deg));
  }
}

// Copies the coefficients into the camera; reports a distortion model of the other camera model.
void set_distortion(const JsonReader& in, const std::optional<DistortionForm>& form, Camera& camera) {
  if (!form) return;
  if (form->model != camera.model)
    return in.fail("distortion", fmt::format("of a {} must have the model \"{}\"", word_of(kCameraModels, camera.model),
                                             word_of(kDistortions, camera.model)));
  if (camera.model == CameraModel::pinhole)
    camera.distortion = {form->k1, form->k2, form->k3, form->p1, form->p2};
  else
    camera.fisheye = {form->k1, form->k2, form->k3, form->k4};
}

std::optional<Camera> resolve_camera(const JsonReader& in, const CameraForm& form, const ReadContext&) {
  const std::size_t before = in.faults();
  Camera camera{form.width, form.height};
  camera.model = form.model;
  set_distortion(in, form.distortion, camera);
  if (form.fov_deg) check_field_of_view(in, camera, *form.fov_deg);
  if (in.faults() != before) return std::nullopt;
  camera.fx = form.fov_deg ? focal_length_px(camera, *form.fov_deg)
              : form.fx    ? *form.fx
                           : *form.focal_length_mm * 1000 / *form.pixel_pitch_um;
  camera.fy = form.fy.value_or(camera.fx);
  // The principal point defaults to the image's middle: pixel centres are at whole numbers from 0.
  camera.cx = form.cx.value_or(0.5 * (camera.width - 1));
  camera.cy = form.cy.value_or(0.5 * (camera.height - 1));
  if (!kFocalLength_px.contains(camera.fx))
    in.fail(form.fov_deg ? "fov_deg" : "focal_length_mm",
            fmt::format("gives a focal length of {:.3g} px; must be at least {} and at most {} px", camera.fx,
                        kFocalLength_px.min, kFocalLength_px.max));
  return in.faults() == before ? std::optional(camera) : std::nullopt;
}

// Returns the form in which a camera is written: intrinsics in pixels.
CameraForm form_of(const Camera& c) {
  const engine::Distortion& d = c.distortion;
  const engine::FisheyeDistortion& f = c.fisheye;
  const DistortionForm distortion = c.model == CameraModel::pinhole
                                        ? DistortionForm{c.model, d.k1, d.k2, d.k3, 0, d.p1, d.p2}
                                        : DistortionForm{c.model, f.k1, f.k2, f.k3, f.k4, 0, 0};
  CameraForm form;
  form.model = c.model;
  form.width = c.width;
  form.height = c.height;
  form.fx = c.fx;
  form.fy = c.fy;
  form.cx = c.cx;
  form.cy = c.cy;
  form.distortion = distortion;
  return form;
}

}  // namespace

void check_rendered_size(const JsonReader& in, const Camera& camera, const Limits& limits) {
  for (const auto& [member, side] : {std::pair("width", camera.width), {"height", camera.height}})
    if (side > limits.max_image_side)
      in.fail(member, fmt::format("must be at most {} of a frame (--max-image-side)", limits.max_image_side));
  if (std::int64_t{camera.width} * camera.height > limits.max_image_pixels)
    in.fail(fmt::format("{} x {} are more pixels than the {} that this service renders", camera.width, camera.height,
                        limits.max_image_pixels));
}

OrderedJson rendered_size_condition(const Limits& limits) {
  const OrderedJson side{{"maximum", limits.max_image_side}};
  return {{"properties", {{"camera", {{"properties", {{"width", side}, {"height", side}}}}}}}};
}

const Members<CameraForm, Camera>& camera_members() {
  static const auto table = make_table<Members<CameraForm, Camera>>(
      "Camera",
      "A pinhole or a fisheye, by `fov_deg`, by `fx`, `fy`, `cx`, `cy` or by `focal_length_mm` and `pixel_pitch_um`. "
      "The centre of the top-left pixel is (0, 0). "
      "A fisheye without distortion is equidistant: radius = f theta. It is rendered by ray tracing. The service "
      "limits "
      "the sides of a frame, and width x height.",
      [](auto& m) {
        m.add("model", &CameraForm::model, Word{kCameraModels}, "projection");
        m.add("width", &CameraForm::width, Integer{1, kMaxSide, "px"}, "columns").required();
        m.add("height", &CameraForm::height, Integer{1, kMaxSide, "px"}, "rows").required();
        m.add("fov_deg", &CameraForm::fov_deg, Number{kFisheyeFieldOfView_deg, "deg"},
              "full horizontal angle: fx = fy = (width/2) / tan(fov/2) for a pinhole (below 180), (width/2) / "
              "radius(fov/2) for a fisheye; principal point in the middle");
        m.add("fx", &CameraForm::fx, Number{kFocalLength_px, "px"}, "focal length");
        m.add("fy", &CameraForm::fy, Number{kFocalLength_px, "px"}, "focal length; default: fx");
        m.add("cx", &CameraForm::cx, Number{kPrincipalPoint_px, "px"}, "principal point; default: (width-1)/2");
        m.add("cy", &CameraForm::cy, Number{kPrincipalPoint_px, "px"}, "principal point; default: (height-1)/2");
        m.add("focal_length_mm", &CameraForm::focal_length_mm, Number{{0, 1e6, true, false}, "mm"},
              "fx = fy = 1000 focal_length_mm / pixel_pitch_um; principal point in the middle");
        m.add("pixel_pitch_um", &CameraForm::pixel_pitch_um, Number{{0, 1e4, true, false}, "um"},
              "distance between the centres of neighbouring pixels; with a `sensor`, that of its detector");
        m.add("distortion", &CameraForm::distortion, Object{distortion_members()}, "lens distortion; left out: none");
        m.add_condition([](const Limits&) {
          return OrderedJson{{"if", {{"properties", {{"model", {{"const", "fisheye"}}}}}, {"required", {"model"}}}},
                             {"else", {{"properties", {{"fov_deg", {{"exclusiveMaximum", kFieldOfView_deg.max}}}}}}}};
        });
        m.exactly_one({"fov_deg", "fx", "focal_length_mm"});
        m.excludes("fov_deg", {"fy", "cx", "cy"});
        m.excludes("focal_length_mm", {"fy", "cx", "cy"});
        m.needs("focal_length_mm", {"pixel_pitch_um"});
        m.needs("pixel_pitch_um", {"focal_length_mm"});
        m.resolve(resolve_camera);
        m.unresolve([](const Camera& camera) { return form_of(camera); });
      });
  return *table;
}

}  // namespace selenograph::api
