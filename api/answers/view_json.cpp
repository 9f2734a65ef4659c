// Tables of an answer's members (api/schema/answers.h). A row is a.add(name in JSON, JSON Schema, function that returns
// the value, condition); a member without a condition is always written.
#include "api/answers/view_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "api/json/ranges.h"
#include "dem/grid/rotation.h"
#include "engine/camera/view.h"

namespace selenograph::api {
namespace {

// Limits beyond which a frame gets a warning: size of a post in the image, and share of pixels that see no data.
constexpr double kMaxPost_px = 8, kMaxMissing = 0.5;

// Returns the angle between the boresight of an attitude and the nadir, radians; empty if the boresight misses the
// Moon.
std::optional<double> off_nadir(const Vec3& position_m, const Quat& camera_from_moon) {
  const Vec3 boresight = camera_from_moon.conjugate() * Vec3::unit_z();
  if (!on_sphere(position_m, boresight)) return std::nullopt;
  return angle_between(boresight, -position_m);
}

// Returns the point where the boresight hits the sphere; empty if it misses.
std::optional<Geographic> boresight_on_sphere(const engine::Pose& pose) {
  const auto point = on_sphere(pose.position_m, pose.camera_from_moon.conjugate() * Vec3::unit_z());
  return point ? std::optional(to_geographic(*point)) : std::nullopt;
}

// Returns the share of an image in which has(x_px, y_px) is true, estimated on a grid of 32 x 32 points.
template <typename Property>
double share_of_image(const engine::Camera& camera, const Property& has) {
  constexpr int kSamplesPerSide = 32;
  int count = 0;
  for (int j = 0; j < kSamplesPerSide; ++j)
    for (int i = 0; i < kSamplesPerSide; ++i)
      count += has((i + 0.5) / kSamplesPerSide * camera.width - 0.5, (j + 0.5) / kSamplesPerSide * camera.height - 0.5)
                   ? 1
                   : 0;
  return static_cast<double>(count) / (kSamplesPerSide * kSamplesPerSide);
}

// Returns the share of the image that sees the sphere.
double share_of_moon(const engine::View& view) {
  return share_of_image(view.camera(), [&](double x_px, double y_px) {
    const auto ray = view.ray(x_px, y_px);
    return ray && on_sphere(view.position(), ray->normalized());
  });
}

// Returns true if the boresight misses the Moon, but that of the inverse attitude would hit it, and the inverse
// attitude would see at least twice as much of the Moon.
bool inverse_sees_more(const engine::FrameRequest& request) {
  constexpr double kMinRatio = 2;
  const engine::Pose &pose = request.pose, inverse{pose.position_m, pose.camera_from_moon.conjugate()};
  if (off_nadir(pose.position_m, pose.camera_from_moon) || !off_nadir(inverse.position_m, inverse.camera_from_moon))
    return false;
  const engine::View view(request.camera, pose);
  return share_of_moon(view.at(inverse)) >= kMinRatio * share_of_moon(view);
}

constexpr std::string_view kInverse = "is it the inverse, camera_from_moon and moon_from_camera swapped?";

// Returns questions about the usual mistakes that would turn an attitude that looks at the Moon into this one. Each
// mistake is undone; those with which the boresight hits the Moon are listed, nearest to the Moon's centre first.
std::string likely_mistake(const engine::Pose& pose) {
  // The constructor takes w, x, y, z.
  const Quat q = pose.camera_from_moon, inverse = q.conjugate();
  const Quat half_turn(0, 1, 0, 0);  // about x: from OpenGL's camera axes to OpenCV's, and back
  // Returns the quaternion that the client meant with these four numbers: they were written x, y, z, w but read as w,
  // x, y, z, or the other way round.
  const auto scalar_last = [](const Quat& p) { return Quat(p.z, p.w, p.x, p.y); };
  const auto scalar_first = [](const Quat& p) { return Quat(p.x, p.y, p.z, p.w); };
  struct Mistake {
    Quat intended;  // the attitude without the mistake
    std::string_view question;
  };
  const char* const asks_scalar_last = "are its components in the order x, y, z, w? w is the scalar part";
  const char* const asks_scalar_first = "are its components in the order w, x, y, z, and were taken for x, y, z, w?";
  const Mistake mistakes[] = {
      {inverse, kInverse},
      {half_turn * q, "are its axes OpenGL's (+y up, -z boresight)? Then say \"axes\": \"opengl\""},
      {half_turn * inverse, "is it the inverse, with OpenGL's axes (+y up, -z boresight)?"},
      // The client may have given moon_from_camera, whose numbers are those of the inverse: reorder them, then invert.
      {scalar_last(q), asks_scalar_last},
      {scalar_last(inverse).conjugate(), asks_scalar_last},
      {scalar_first(q), asks_scalar_first},
      {scalar_first(inverse).conjugate(), asks_scalar_first}};
  std::vector<std::pair<double, std::string_view>> found;  // angle in nanoradians; each question once
  for (const Mistake& m : mistakes) {
    const auto angle = off_nadir(pose.position_m, m.intended);
    if (!angle) continue;
    // Round the angle, so that angles equal but for rounding errors stay in the order of the table.
    const double nano_rad = std::round(*angle * 1e9);
    const auto same_question = std::ranges::find(found, m.question, &std::pair<double, std::string_view>::second);
    if (same_question == found.end())
      found.emplace_back(nano_rad, m.question);
    else
      same_question->first = std::min(same_question->first, nano_rad);
  }
  if (found.empty()) return {};
  std::ranges::stable_sort(found, {}, &std::pair<double, std::string_view>::first);
  std::string text = "an attitude of the same numbers would look at the Moon: " + std::string(found[0].second);
  for (std::size_t i = 1; i < found.size(); ++i)
    text += (text.ends_with('?') ? " Or: " : ". Or: ") + std::string(found[i].second);
  return text;
}

// Returns the diameter of the Moon's disc in the middle of the image, in pixels; a huge number for a camera below the
// sphere.
double moon_px(const engine::FrameRequest& request) {
  const double distance_m = request.pose.position_m.norm();
  return distance_m > kMoonRadius_m ? 2 * request.camera.fx * std::tan(std::asin(kMoonRadius_m / distance_m)) : 1e9;
}

// Returns the warning for a frame without Moon.
std::string why_nothing(const engine::FrameRequest& request) {
  std::string text = "nothing of the Moon is in view (view.off_nadir_deg: the boresight's angle from the nadir)";
  if (moon_px(request) < 1) return text + "; from there the Moon is smaller than a pixel: lengths are metres";
  if (const std::string mistake = likely_mistake(request.pose); !mistake.empty()) text += "; " + mistake;
  return text;
}

// Returns true if a tile of the catalogue covers the place.
bool has_data(const dem::Catalogue& catalogue, double lat_deg, double lon_deg) {
  return !catalogue.touching(lat_deg, lat_deg, lon_deg, lon_deg).empty();
}

// Returns an explanation of missing data at the boresight: there are data with latitude and longitude swapped, or with
// both taken for radians. Empty if the boresight misses the Moon or hits data.
std::string why_missing(const engine::FrameRequest& request, const dem::Catalogue& catalogue) {
  const std::optional<Geographic> g = boresight_on_sphere(request.pose);
  if (!g || has_data(catalogue, g->lat_deg, g->lon_deg)) return {};
  std::string text = ": there are none along the boresight (view.sphere)";
  if (std::abs(g->lon_deg) <= 90 && has_data(catalogue, g->lon_deg, g->lat_deg))
    text += ", but there are at swapped latitude and longitude: are they swapped?";
  const double lat_deg = g->lat_deg * kDegreesPerRadian, lon_deg = g->lon_deg * kDegreesPerRadian;
  if (std::abs(lat_deg) <= 90 && std::abs(lon_deg) <= 360 && has_data(catalogue, lat_deg, lon_deg))
    text += ", but there are at as many radians instead of degrees: are they in radians?";
  return text;
}

}  // namespace

const Answer<ViewSource>& view_answer() {
  using S = ViewSource;
  using namespace schema;
  static const auto answer = make_answer<S>(
      "The view in terms of the ground. null: where no terrain is hit, or an object hides it; for the boresight also "
      "where it is outside the image. Absent without terrain",
      [](auto& a) {
        const auto at_boresight = [](double Geographic::*member) {
          return [member](const S& s) {
            return s.view.boresight ? std::optional((*s.view.boresight).*member) : std::nullopt;
          };
        };
        a.add("lat_deg", number_or_null("latitude where the boresight meets the terrain"),
              at_boresight(&Geographic::lat_deg));
        a.add("lon_deg", number_or_null("longitude where the boresight meets the terrain"),
              at_boresight(&Geographic::lon_deg));
        a.add("height_m", number_or_null("height where the boresight meets the terrain"),
              at_boresight(&Geographic::height_m));
        const OrderedJson place_on_sphere =
            object("", {{"lat_deg", number(kLatitude_deg, "")}, {"lon_deg", number(kLongitude_deg, "")}},
                   {"lat_deg", "lon_deg"});
        const auto place_json = [](const std::optional<Geographic>& point) {
          return point ? OrderedJson{{"lat_deg", point->lat_deg}, {"lon_deg", point->lon_deg}} : OrderedJson();
        };
        a.add("sphere",
              {{"anyOf", {place_on_sphere, {{"type", "null"}}}},
               {"description", "where the boresight hits the sphere of 1 737 400 m, with or without data there"}},
              [place_json](const S& s) { return place_json(boresight_on_sphere(s.query.request.pose)); });
        a.add("off_nadir_deg", number(kAnyNumber, "angle between the boresight and the direction to the Moon's centre"),
              [](const S& s) { return s.view.off_nadir_deg; });
        a.add("up_azimuth_deg", number_or_null("compass azimuth there of the image's up direction"),
              [](const S& s) { return s.view.up_azimuth_deg; });
        a.add("corners",
              list({{"anyOf", {place_on_sphere, {{"type", "null"}}}}}, 4,
                   "points seen by the corner pixels' centres: upper left, upper right, lower right, lower left"),
              [place_json](const S& s) {
                OrderedJson corners = OrderedJson::array();
                for (const auto& corner : s.view.corners) corners.push_back(place_json(corner));
                return corners;
              });
        a.add(
            "sun",
            object("The Sun at that place; absent where the request has none.",
                   {{"azimuth_deg", number_or_null("clockwise from north")},
                    {"elevation_deg", number_or_null("above the sphere's horizon")}},
                   {"azimuth_deg", "elevation_deg"}),
            [](const S& s) {
              return OrderedJson{{"azimuth_deg", answer_json(s.view.sun_azimuth_deg)},
                                 {"elevation_deg", answer_json(s.view.sun_elevation_deg)}};
            },
            [](const S& s) { return s.query.sun_given; });
        a.add("post_px", number_or_null("post spacing of the DEM there in pixels, across the line of sight"),
              [](const S& s) { return s.view.post_px; });
      });
  return answer;
}

void add_lens_warning(const engine::Camera& camera, OrderedJson& warnings) {
  constexpr double kMaxUnmappedShare = 0.5, kMaxWidth_deg = 140;
  if (camera.rectilinear()) {
    const double half = std::max(camera.width / camera.fx, camera.height / camera.fy) / 2;
    if (const double across_deg = 2 * std::atan(half) * kDegreesPerRadian; across_deg > kMaxWidth_deg)
      warnings.push_back(
          fmt::format("the image spans {:.0f} degrees: check its units (fx and fy are pixels, focal_length_mm is "
                      "millimetres, fov_deg is degrees)",
                      across_deg));
    return;
  }
  const engine::Projection projection(camera);
  const double unmapped =
      share_of_image(camera, [&](double x_px, double y_px) { return !projection.direction(x_px, y_px); });
  if (unmapped <= kMaxUnmappedShare) return;
  // A camera beyond the image plane is a fisheye, which images directions up to a largest angle from its boresight.
  if (camera.cahvor) {
    warnings.push_back(
        "most of the image is beyond a fold of `cahvor` or more than 90 degrees from the camera's +z: check that its "
        "vectors are in camera axes and belong to this image size, and order and signs of R");
    return;
  }
  warnings.push_back(
      camera.beyond_plane()
          ? "most of the image is beyond what the fisheye images: make fov_deg smaller or fx larger, or width and "
            "height smaller"
          : "most of the image is beyond a fold of the lens distortion, where nothing is imaged: check order and signs "
            "of its coefficients, and that fx, cx and cy belong to this image size");
}

void add_view_warnings(const FrameQuery& query, const engine::FrameReport& report, const dem::Catalogue& catalogue,
                       OrderedJson& warnings) {
  const engine::FrameRequest& request = query.request;
  const bool shows_sky = request.sky && request.sky->any();  // then a view past the Moon may be intended
  if (!shows_sky && !(report.hit_fraction > 0) && !(report.missing_fraction > 0))
    warnings.push_back(why_nothing(request));
  else if (!shows_sky && !report.view.boresight && inverse_sees_more(request))
    warnings.push_back(
        fmt::format("the boresight is in the sky, but the inverse attitude would see the ground: {}", kInverse));
  if (report.missing_fraction > kMaxMissing)
    warnings.push_back("most of the pixels look at places without data (missing_fraction)" +
                       why_missing(request, catalogue));
  if (!query.request.detail && report.view.post_px && *report.view.post_px > kMaxPost_px) {
    constexpr double kFarTooWide_px = 100;
    warnings.push_back(fmt::format(
        "the posts of the DEM are more than {} pixels wide in the middle of the image (view.post_px): it has "
        "nothing that is smaller{}",
        kMaxPost_px, *report.view.post_px > kFarTooWide_px ? "; heights are metres, angles are degrees" : ""));
  }
}

}  // namespace selenograph::api
