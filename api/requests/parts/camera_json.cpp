// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/parts/camera_json.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <tuple>

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
constexpr std::pair<std::string_view, DistortionModel> kDistortions[] = {
    {"brown_conrady", DistortionModel::brown_conrady},
    {"opencv", DistortionModel::opencv},
    {"kannala_brandt", DistortionModel::kannala_brandt},
};
// Angle of a sensor's tilt, and of CAHVOR's vectors A and O from the camera's axis and from each other.
constexpr Range kTilt_deg{-60, 60};
constexpr double kMinCosine = 0.5;
// Sine of the smallest angle between the directions of rows and columns: 60 degrees.
constexpr double kMinAxesSine = 0.866;

const Members<DistortionForm>& distortion_members() {
  static const auto table = make_table<Members<DistortionForm>>(
      "Distortion",
      "Pinhole: Brown-Conrady with OpenCV's coefficients, on the plane z = 1: x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + "
      "2 p1 x y + p2 (r^2 + 2 x^2), and y' accordingly. `opencv` is the rest of OpenCV's model: the radial factor is "
      "divided by 1 + k4 r^2 + k5 r^4 + k6 r^6, s1 r^2 + s2 r^4 is added to x' and s3 r^2 + s4 r^4 to y', and the "
      "sensor is tilted. Fisheye: Kannala-Brandt, as in OpenCV's fisheye module: radius = theta (1 + k1 theta^2 + k2 "
      "theta^4 + k3 theta^6 + k4 theta^8), theta: angle from the boresight in radians. Nothing is imaged from the "
      "radius on at which the distortion folds: where the image of a growing radius turns back.",
      [](auto& m) {
        m.add("model", &DistortionForm::model, Word{kDistortions}, "distortion model");
        m.add("k1", &DistortionForm::k1, Number{kDistortion}, "radial, r^2 or theta^2");
        m.add("k2", &DistortionForm::k2, Number{kDistortion}, "radial, r^4 or theta^4");
        m.add("k3", &DistortionForm::k3, Number{kDistortion}, "radial, r^6 or theta^6");
        m.add("k4", &DistortionForm::k4, Number{kDistortion}, "radial, r^2 of the divisor, or theta^8")
            .only_for({"opencv", "kannala_brandt"});
        m.add("k5", &DistortionForm::k5, Number{kDistortion}, "radial, r^4 of the divisor").only_for({"opencv"});
        m.add("k6", &DistortionForm::k6, Number{kDistortion}, "radial, r^6 of the divisor").only_for({"opencv"});
        m.add("p1", &DistortionForm::p1, Number{kDistortion}, "tangential").only_for({"brown_conrady", "opencv"});
        m.add("p2", &DistortionForm::p2, Number{kDistortion}, "tangential").only_for({"brown_conrady", "opencv"});
        m.add("s1", &DistortionForm::s1, Number{kDistortion}, "thin prism, r^2 of x'").only_for({"opencv"});
        m.add("s2", &DistortionForm::s2, Number{kDistortion}, "thin prism, r^4 of x'").only_for({"opencv"});
        m.add("s3", &DistortionForm::s3, Number{kDistortion}, "thin prism, r^2 of y'").only_for({"opencv"});
        m.add("s4", &DistortionForm::s4, Number{kDistortion}, "thin prism, r^4 of y'").only_for({"opencv"});
        m.add("tau_x_deg", &DistortionForm::tau_x_deg, Number{kTilt_deg, "deg"},
              "tilt of the sensor about x: OpenCV's tau_x, which is in radians")
            .only_for({"opencv"});
        m.add("tau_y_deg", &DistortionForm::tau_y_deg, Number{kTilt_deg, "deg"},
              "tilt of the sensor about y, after that about x: OpenCV's tau_y")
            .only_for({"opencv"});
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
  const DistortionForm& f = *form;
  const bool is_fisheye = camera.model == CameraModel::fisheye;
  if ((f.model == DistortionModel::kannala_brandt) != is_fisheye)
    return in.fail("distortion", fmt::format("of a {} must have the model {}", word_of(kCameraModels, camera.model),
                                             is_fisheye ? "\"kannala_brandt\"" : "\"brown_conrady\" or \"opencv\""));
  if (is_fisheye) {
    camera.fisheye = {f.k1, f.k2, f.k3, f.k4};
    return;
  }
  camera.distortion = {f.k1, f.k2, f.k3, f.p1, f.p2, f.k4,        f.k5,
                       f.k6, f.s1, f.s2, f.s3, f.s4, f.tau_x_deg, f.tau_y_deg};
}

DistortionForm form_of(const engine::Distortion& d) {
  return {d.is_brown() ? DistortionModel::brown_conrady : DistortionModel::opencv,
          d.k1,
          d.k2,
          d.k3,
          d.k4,
          d.k5,
          d.k6,
          d.p1,
          d.p2,
          d.s1,
          d.s2,
          d.s3,
          d.s4,
          d.tau_x_deg,
          d.tau_y_deg};
}

// Returns a vector of unit length; reports one that is none, or that is far from the camera's axis.
Vec3 unit_near_axis(const JsonReader& in, std::string_view member, const Vec3& vector) {
  constexpr double kRounding = 1e-15;
  const double length = vector.norm();
  if (!(std::abs(length - 1) <= kQuaternionTolerance))
    in.fail(member,
            fmt::format("has length {:.6g}; a unit vector is needed (within {})", length, kQuaternionTolerance));
  else if (vector.z() < kMinCosine)
    in.fail(member,
            "points more than 60 degrees away from +z: the vectors are in camera axes (+x right, +y down, +z along the "
            "boresight)");
  return std::abs(length - 1) <= kRounding ? vector : Vec3(vector / length);
}

std::optional<engine::Cahvor> resolve_cahvor(const JsonReader& in, const CahvorForm& form, const ReadContext&) {
  const std::size_t before = in.faults();
  engine::Cahvor c{unit_near_axis(in, "A", form.a), form.h, form.v, {}, form.r, form.linearity};
  c.o = form.o ? unit_near_axis(in, "O", *form.o) : c.a;
  if (in.faults() != before) return std::nullopt;
  if (c.a.dot(c.o) < kMinCosine) in.fail("O", "points more than 60 degrees away from A");
  if (!(c.r[0] > -1)) in.fail("R", "begins with a number of -1 or less: 1 + r0 scales the image");
  for (const auto& [member, focal_px, centre_px] : {std::tuple("H", c.fx(), c.cx()), std::tuple("V", c.fy(), c.cy())})
    if (!kFocalLength_px.contains(focal_px) || !kPrincipalPoint_px.contains(centre_px))
      in.fail(member,
              fmt::format("gives a focal length of {:.3g} px and a principal point of {:.3g} px; at least {} and "
                          "at most {} px, and between {} and {} px, are possible",
                          focal_px, centre_px, kFocalLength_px.min, kFocalLength_px.max, kPrincipalPoint_px.min,
                          kPrincipalPoint_px.max));
  if (in.faults() == before && c.h.cross(c.v).dot(c.a) < kMinAxesSine * c.fx() * c.fy())
    in.fail("V",
            "and H are not within 30 degrees of square, or mirrored: seen along A, columns count to the right and "
            "rows down");
  return in.faults() == before ? std::optional(c) : std::nullopt;
}

const Members<CahvorForm, engine::Cahvor>& cahvor_members() {
  static const auto table = make_table<Members<CahvorForm, engine::Cahvor>>(
      "Cahvor",
      "CAHVOR and CAHVORE (Yakimovsky and Cunningham 1978, Gennery 2006) in camera axes, with C in the origin: a "
      "direction p = z O + q, q perpendicular to O, becomes p' = z' O + (1 + r0 + r1 chi^2 + r2 chi^4) q with chi = "
      "|q| / z', and is imaged at x = H.p' / A.p', y = V.p' / A.p'. CAHVOR: z' = z. CAHVORE: with theta = atan(|q| / "
      "z) "
      "and linearity L, chi = tan(L theta) / L for L > 0, theta for 0, sin(L theta) / L for L < 0. The vector E, which "
      "moves the entrance pupil along O, is left out: all lines of sight start in C. The Python client's "
      "`Camera.from_cahvor` turns vectors in another frame into camera axes.",
      [](auto& m) {
        constexpr Range kPixels{-1e9, 1e9}, kLinearity{-1, 1};
        m.add("A", &CahvorForm::a, Vector{{-2, 2}}, "unit vector perpendicular to the sensor, within 60 degrees of +z")
            .required();
        m.add("H", &CahvorForm::h, Vector{kPixels, "px"}, "vector of the columns").required();
        m.add("V", &CahvorForm::v, Vector{kPixels, "px"}, "vector of the rows").required();
        m.add("O", &CahvorForm::o, Vector{{-2, 2}}, "unit vector of the optical axis; default: A");
        m.add("R", &CahvorForm::r, Vector{kDistortion}, "radial distortion r0, r1, r2");
        m.add("linearity", &CahvorForm::linearity, Number{kLinearity},
              "1: CAHVOR, and CAHVORE of type 1; 0: CAHVORE of type 2, a fisheye; else CAHVORE of type 3");
        m.resolve(resolve_cahvor);
        m.unresolve([](const engine::Cahvor& c) { return CahvorForm{c.a, c.h, c.v, c.r, c.o, c.linearity}; });
      });
  return *table;
}

// Returns the camera of CAHVOR's vectors. Those of a pinhole, square to the camera's axes, are that pinhole.
Camera camera_of(const engine::Cahvor& c, Camera camera) {
  camera.fx = c.fx();
  camera.fy = c.fy();
  camera.cx = c.cx();
  camera.cy = c.cy();
  const engine::Cahvor pinhole{Vec3::unit_z(), {camera.fx, 0, camera.cx}, {0, camera.fy, camera.cy}};
  if (c != pinhole) camera.cahvor = c;
  return camera;
}

// Sets the pinhole that fits a table of lines of sight. Reports an image that is a single row or column.
void set_lines_of_sight(const JsonReader& in, const Named<engine::SightTable>& sights, Camera& camera) {
  for (const auto& [member, side] : {std::pair("width", camera.width), {"height", camera.height}})
    if (side < 2) in.fail(member, "must be at least 2 with lines_of_sight, which go from the first pixel to the last");
  if (camera.width < 2 || camera.height < 2) return;
  set_sights(sights.content, camera);
}

std::optional<Camera> resolve_camera(const JsonReader& in, const CameraForm& form, const ReadContext&) {
  const std::size_t before = in.faults();
  Camera camera{form.width, form.height};
  camera.model = form.model;
  set_distortion(in, form.distortion, camera);
  if (form.fov_deg) check_field_of_view(in, camera, *form.fov_deg);
  for (const auto& [member, given] :
       {std::pair("cahvor", form.cahvor.has_value()), {"lines_of_sight", form.lines_of_sight.has_value()}})
    if (given && camera.model != CameraModel::pinhole) in.fail(member, "is of a pinhole, not of a fisheye");
  if (form.lines_of_sight) set_lines_of_sight(in, *form.lines_of_sight, camera);
  if (in.faults() != before) return std::nullopt;
  if (form.lines_of_sight) return camera;
  if (form.cahvor) return camera_of(*form.cahvor, camera);
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

// Returns the form in which a camera is written: intrinsics in pixels, or CAHVOR's vectors.
CameraForm form_of(const Camera& c) {
  const engine::FisheyeDistortion& f = c.fisheye;
  const DistortionForm distortion = c.model == CameraModel::pinhole
                                        ? form_of(c.distortion)
                                        : DistortionForm{DistortionModel::kannala_brandt, f.k1, f.k2, f.k3, f.k4};
  CameraForm form;
  form.model = c.model;
  form.width = c.width;
  form.height = c.height;
  form.cahvor = c.cahvor;
  if (c.sights) form.lines_of_sight = Named<engine::SightTable>{c.sights->name(), c.sights};
  if (c.cahvor || c.sights) return form;
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
      "A pinhole or a fisheye, by `fov_deg`, by `fx`, `fy`, `cx`, `cy` or by `focal_length_mm` and `pixel_pitch_um`; "
      "or a pinhole by `cahvor` or by `lines_of_sight`. "
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
        m.add("focal_length_mm", &CameraForm::focal_length_mm, Number{above(0).to(1e6), "mm"},
              "fx = fy = 1000 focal_length_mm / pixel_pitch_um; principal point in the middle");
        m.add("pixel_pitch_um", &CameraForm::pixel_pitch_um, Number{above(0).to(1e4), "um"},
              "distance between the centres of neighbouring pixels; with a `sensor`, that of its detector");
        m.add("distortion", &CameraForm::distortion, Object{distortion_members()}, "lens distortion; left out: none");
        m.add("cahvor", &CameraForm::cahvor, Object{cahvor_members()}, "projection of a pinhole as CAHVOR's vectors");
        m.add("lines_of_sight", &CameraForm::lines_of_sight,
              Asset{&Assets::lines_of_sight, "table of lines of sight", "lines_of_sight"},
              "projection of a pinhole as directions: the name of lines_of_sight/NAME.tif of the assets folder, whose "
              "nodes are spread evenly from the centre of the top-left pixel to that of the bottom-right one");
        m.add_condition([](const Limits&) {
          return OrderedJson{{"if", {{"properties", {{"model", {{"const", "fisheye"}}}}}, {"required", {"model"}}}},
                             {"else", {{"properties", {{"fov_deg", {{"exclusiveMaximum", kFieldOfView_deg.max}}}}}}}};
        });
        m.exactly_one({"fov_deg", "fx", "focal_length_mm", "cahvor", "lines_of_sight"});
        m.excludes("fov_deg", {"fy", "cx", "cy"});
        m.excludes("focal_length_mm", {"fy", "cx", "cy"});
        m.excludes("cahvor", {"fy", "cx", "cy", "distortion"});
        m.excludes("lines_of_sight", {"fy", "cx", "cy", "distortion"});
        m.needs("focal_length_mm", {"pixel_pitch_um"});
        m.needs("pixel_pitch_um", {"focal_length_mm"});
        m.resolve(resolve_camera);
        m.unresolve([](const Camera& camera) { return form_of(camera); });
      });
  return *table;
}

}  // namespace selenograph::api
