// The body of a POST, through the reader of every call: what comes out is what the engine trusts.
#include <algorithm>
#include <stdexcept>
#include <string>

#include "api/encode/arrays.h"
#include "api/json/ranges.h"
#include "api/message/problem.h"
#include "api/requests/features_json.h"
#include "api/requests/frame_json.h"
#include "api/requests/map_json.h"
#include "api/requests/mertis_json.h"
#include "api/requests/points_json.h"
#include "api/requests/round_trip_json.h"
#include "dem/base/error.h"
#include "engine/camera/row_views.h"
#include "engine/camera/view.h"
#include "engine/radiometry/brdf.h"
#include "engine/radiometry/radiometry.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/meshes.h"

namespace selenograph::fuzz {
namespace {

using api::Json;

const api::Limits kLimits;
const api::Assets kAssets(SELENOGRAPH_SOURCE_DIR "/deploy/assets", test::mesh_options());

bool is_unit(const Vec3& v) { return std::abs(v.norm() - 1) < 1e-12; }

bool is_place(double lat_deg, double lon_deg) {
  return api::kLatitude_deg.contains(lat_deg) && api::kLongitude_deg.contains(lon_deg);
}

bool is_coordinate(const Vec3& v) {
  return api::kCoordinate_m.contains(v.x()) && api::kCoordinate_m.contains(v.y()) && api::kCoordinate_m.contains(v.z());
}

// A refusal tells the client where: each pointer is one (RFC 6901) and leads into the document, at most one member past
// what is there.
void check_refusal(const api::RequestError& refusal, const Json* document) {
  require(refusal.code() == "invalid_request" || (!document && refusal.code() == "malformed_json"),
          "the client is told its fault");
  for (const api::Finding& finding : refusal.findings()) {
    require(!finding.detail.empty(), "a finding says what is wrong");
    const Json::json_pointer pointer(finding.pointer);
    require(!document || pointer.empty() || document->contains(pointer.parent_pointer()),
            "the pointer leads somewhere:", finding.pointer);
  }
  const api::Response answer = api::problem(refusal.code(), refusal.what(), refusal.findings());
  require(answer.status >= 400 && answer.status < 500, "a refusal is a 4xx");
  require(Json::parse(answer.body).at("status") == answer.status, "a refusal is JSON");
}

void check_camera(const engine::Camera& c) {
  require(c.width >= 1 && c.height >= 1 && c.width <= kLimits.max_image_side && c.height <= kLimits.max_image_side &&
              std::int64_t{c.width} * c.height <= kLimits.max_image_pixels,
          "the image is within its limits");
  require(api::kFocalLength_px.contains(c.fx) && api::kFocalLength_px.contains(c.fy), "focal lengths are in range");
  require(std::isfinite(c.cx) && std::isfinite(c.cy), "the principal point is finite");
  const engine::Distortion& d = c.distortion;
  for (const double k : {d.k1, d.k2, d.k3, d.k4, d.k5, d.k6, d.p1, d.p2, d.s1, d.s2, d.s3, d.s4})
    require(api::kDistortion.contains(k), "distortion is in range");
  if (c.cahvor) require(is_unit(c.cahvor->a) && is_unit(c.cahvor->o), "the vectors are directions");
}

void check_pose(const engine::Pose& pose) {
  require(is_coordinate(pose.position_m), "the position is in range");
  require(std::abs(pose.camera_from_moon.norm() - 1) < 1e-12, "the attitude is a unit quaternion");
  require(pose.camera_from_moon.w >= 0, "one attitude, one quaternion");
}

void check_sun(const engine::Sun& sun) {
  require(is_unit(sun.direction), "the Sun is a direction");
  require(api::kDistance_au.contains(sun.distance_au) && api::kAngularRadius_deg.contains(sun.angular_radius_deg),
          "the Sun is in range");
}

// Pixels to directions and back, where the lens has an inverse.
void check_view(const engine::Camera& camera, const engine::Pose& pose) {
  const engine::View view(camera, {Vec3::zero(), pose.camera_from_moon});
  for (const double x : {0.0, 0.5 * (camera.width - 1), camera.width - 1.0})
    for (const double y : {0.0, camera.height - 1.0}) {
      const auto ray = view.ray(x, y);
      if (!ray) continue;
      require(ray->is_finite(), "a ray is finite");
      require(std::abs((view.moon_from_camera().transpose() * *ray).z() - 1) < 1e-6 * ray->norm(), "its depth is 1");
    }
}

// Rows have views wherever the camera doesn't leave for good.
void check_shutter(engine::Camera camera, const engine::Pose& pose, const engine::Shutter& shutter) {
  require(shutter.line_time_s > 0, "rows follow each other");
  require(shutter.poses.size() != 1, "poses are several or none");
  camera.height = std::min(camera.height, 8);
  try {
    const engine::RowViews views(camera, pose, shutter);
    for (int row = 0; row < camera.height; ++row)
      require(views.of(row).position().is_finite() && views.of(row).moon_from_camera().is_finite(), "a row has a pose");
  } catch (const ImpossibleRequest&) {
  }
}

void check_object(const engine::SceneObject& object) {
  require(is_coordinate(object.position_m), "an object's position is in range");
  require(std::abs(object.moon_from_object.norm() - 1) < 1e-12, "an object's attitude is a unit quaternion");
  require(api::kScale.contains(object.scale), "an object has a size");
  require(object.mesh && object.materials.size() == object.mesh->shape().parts.size(), "each part has its material");
}

void check_frame(const Json& document) {
  const api::FrameQuery query = api::read_frame(document, kLimits, kAssets);
  const engine::FrameRequest& request = query.request;
  check_camera(request.camera);
  check_pose(request.pose);
  if (query.sun_given) check_sun(request.sun);
  require(request.products != 0, "something is asked for");
  for (const api::ProductRow& row : api::products())
    require(query.sun_given || !row.needs_sun || !(request.products & row.product), "no light without a Sun");
  const int samples = request.accuracy.samples_per_pixel, side = static_cast<int>(std::lround(std::sqrt(samples)));
  require(samples >= 1 && samples <= kLimits.max_samples_per_pixel && side * side == samples, "samples are a square");
  require(api::kMaxError_px.contains(request.accuracy.max_error_px), "the error bound is in range");
  require(api::kUnitInterval.contains(request.reflectance.rho) &&
              api::kUnitInterval.contains(request.reflectance.lommel_seeliger_weight),
          "reflectance is in range");
  const engine::RadianceTerms terms = engine::radiance_terms(request);
  require(terms.direct_w_m2 >= 0 && std::isfinite(terms.direct_w_m2) && terms.base_w_m2_sr() >= 0 &&
              std::isfinite(terms.base_w_m2_sr()),
          "radiance is finite");
  const double reflected = engine::Brdf(request.reflectance).times_mu0(0.5, 0.7, 0.3);
  require(reflected >= 0 && std::isfinite(reflected), "reflectance is finite");
  // The answer's metadata hold the request as it was understood: sent back, it must mean the same.
  const std::string resolved = api::resolved_json(query).dump();
  try {
    const std::string again = api::resolved_json(api::read_frame(api::parse_json(resolved), kLimits, kAssets)).dump();
    require(again == resolved, "a resolved request resolves to itself:", resolved + "\n" + again);
  } catch (const api::RequestError& refusal) {
    require(false, "a resolved request is a valid one:",
            resolved + "\n" + api::problem(refusal.code(), refusal.what(), refusal.findings()).body);
  }
  check_view(request.camera, request.pose);
  if (request.shutter) check_shutter(request.camera, request.pose, *request.shutter);
  for (const engine::SceneObject& object : request.objects) check_object(object);
  require(request.terrain || !request.objects.empty(), "something is there");
}

void check_map(const Json& document) {
  const api::MapQuery query = api::read_map(document, kLimits, kAssets);
  const dem::MapGrid& grid = query.request.grid;
  require(grid.width >= 1 && grid.height >= 1 && std::int64_t{grid.width} * grid.height <= kLimits.max_map_pixels,
          "the map is within its limits");
  require(std::isfinite(grid.west_m) && std::isfinite(grid.north_m), "the map lies somewhere");
  const dem::MapTransform map(grid.plane);
  for (const int column : {0, grid.width - 1})
    for (const int row : {0, grid.height - 1})
      if (const auto d = map.direction(grid.point(column, row)))
        require(std::abs(d->norm() - 1) < 1e-12, "a pixel has a direction");
  if (query.sun_given) check_sun(query.request.scenery.sun);
  require(!query.request.toward_viewer || is_unit(*query.request.toward_viewer), "the viewer is in a direction");
  const std::string resolved = api::resolved_json(query).dump();
  require(api::resolved_json(api::read_map(Json::parse(resolved), kLimits, kAssets)).dump() == resolved,
          "a resolved request resolves to itself:", resolved);
}

void check_rays(const Json& document) {
  const api::RaysQuery query = api::read_rays(document, kLimits);
  require(!query.rays.empty() && query.rays.size() <= static_cast<std::size_t>(kLimits.max_rays),
          "some rays, not too many");
  for (const engine::Ray& ray : query.rays)
    require(is_coordinate(ray.origin_m) && is_unit(ray.direction), "a ray is one");
  if (query.sun_given) check_sun(query.request.sun);
}

void check_project(const Json& document) {
  const api::ProjectQuery query = api::read_project(document, kLimits);
  check_camera(query.camera);
  check_pose(query.pose);
  if (query.shutter) check_shutter(query.camera, query.pose, *query.shutter);
  if (query.sun_given) check_sun(query.request.sun);
  for (const engine::LandmarkQuery& point : query.points) {
    require(is_place(point.lat_deg, point.lon_deg), "a landmark is a place");
    require(!point.height_m || api::kHeight_m.contains(*point.height_m), "its height is in range");
  }
}

void check_heights(const Json& document) {
  for (const Geographic& place : api::read_heights(document, kLimits).points)
    require(is_place(place.lat_deg, place.lon_deg), "a place is one");
}

void check_features(const Json& document) {
  const api::FeaturesQuery query = api::read_features(document, kLimits, kAssets);
  require(query.min_diameter_m() > 0 && std::isfinite(query.min_diameter_m()), "the least diameter is a length");
  require(query.bytes() < std::size_t{1} << 32, "what is listed is bounded");
  const dem::Footprint region = query.region();
  require(region.south_deg < region.north_deg && region.west_deg < region.east_deg &&
              region.east_deg - region.west_deg <= 360,
          "the region has an inside");
}

void check_mertis(const Json& document) { api::read_mertis(document); }

void check_round_trip(const Json& document) { api::read_round_trip(document, kLimits); }

}  // namespace
}  // namespace selenograph::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace selenograph;
  api::Json document;
  try {
    document = api::parse_json(fuzz::text_of(data, size));
  } catch (const api::RequestError& refusal) {
    fuzz::check_refusal(refusal, nullptr);
    return 0;
  }
  fuzz::require(api::parse_json(document.dump()) == document, "JSON that was read is written and read again");
  for (const auto check : {fuzz::check_frame, fuzz::check_map, fuzz::check_rays, fuzz::check_project,
                           fuzz::check_heights, fuzz::check_features, fuzz::check_mertis, fuzz::check_round_trip}) {
    try {
      check(document);
    } catch (const api::RequestError& refusal) {
      fuzz::check_refusal(refusal, &document);
    }
  }
  return 0;
}
