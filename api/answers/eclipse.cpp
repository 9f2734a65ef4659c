#include "api/answers/eclipse.h"

#include <fmt/format.h>

#include "dem/grid/map_grid.h"
#include "engine/frame/needs.h"
#include "engine/sky/earth_figure.h"

namespace selenograph::api {
namespace {

// Returns the share of the Sun's disc that the Earth covers at the query's epoch, seen from the sphere below a position
// in MOON_ME; 0 without an epoch.
double share_covered_over(const SceneryQuery& query, const Vec3& position_m) {
  if (query.sun_utc.empty()) return 0;
  return engine::share_of_sun_covered(query.sun_utc, kMoonRadius_m * position_m.stable_normalized());
}

// Returns the camera's position; with a pose for each row that of the middle pose.
Vec3 position_of(const engine::Pose& pose, const std::optional<engine::Shutter>& shutter) {
  const bool has_row_poses = shutter && !shutter->poses.empty();
  return has_row_poses ? shutter->poses[shutter->poses.size() / 2].pose.position_m : pose.position_m;
}

}  // namespace

double sun_covered(const FrameQuery& query) {
  const engine::FrameRequest& request = query.request;
  return engine::wants_light(request) ? share_covered_over(query, position_of(request.pose, request.shutter)) : 0;
}

double sun_covered(const MapQuery& query) {
  if (!(query.request.products & (engine::kRadiance | engine::kLit | engine::kIrradiance))) return 0;
  const dem::MapGrid& grid = query.request.grid;
  const auto middle = dem::MapTransform(grid.plane).direction(grid.point(grid.width / 2, grid.height / 2));
  return share_covered_over(query, middle.value_or(Vec3::zero()));
}

double sun_covered(const RaysQuery& query) { return share_covered_over(query, query.rays.front().origin_m); }

double sun_covered(const ProjectQuery& query) {
  return share_covered_over(query, position_of(query.pose, query.shutter));
}

void warn_of_eclipse(double share, std::string_view member, OrderedJson& warnings) {
  if (share > 0)
    warnings.push_back(
        fmt::format("the Earth covers the Sun or a part of it{}: eclipses of the Sun are not modelled, and the ground "
                    "is lit as if there were none",
                    member.empty() ? std::string() : fmt::format(" ({})", member)));
}

}  // namespace selenograph::api
