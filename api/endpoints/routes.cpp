#include "api/endpoints/routes.h"

namespace selenograph::api {
namespace {

constexpr Route kRoutes[] = {
    {"POST", "/v1/frames", "renderFrame", "frames", "Renders the frame that a camera sees", true, true, true,
     answer_frames, describe_frames},
    {"GET", "/v1/frames/{hash}/meta", "getFrameMetadata", "frames",
     "Metadata of a frame, if it did not fit into the frame's header", false, false, false, answer_frame_metadata,
     describe_frame_metadata},
    {"POST", "/v1/maps", "renderMap", "maps", "Renders a map-projected product", true, true, true, answer_maps,
     describe_maps},
    {"POST", "/v1/rays", "castRays", "geometry", "Casts arbitrary rays: an altimeter or lidar", true, true, true,
     answer_rays, describe_rays},
    {"POST", "/v1/project", "projectPoints", "geometry", "Projects landmarks into a camera's image", true, true, true,
     answer_project, describe_project},
    {"POST", "/v1/sky", "listSky", "geometry", "Lists stars, Sun, Earth and planets as a camera would see them", true,
     true, true, answer_sky, describe_sky},
    {"POST", "/v1/limb", "findLimb", "geometry", "Finds the Moon's limb in a camera's image", true, true, true,
     answer_limb, describe_limb},
    {"POST", "/v1/lidar", "scanLidar", "geometry", "Scans the terrain with a lidar", true, true, true, answer_lidar,
     describe_lidar},
    {"POST", "/v1/heights", "getHeights", "terrain", "Terrain heights at places", true, false, true, answer_heights,
     describe_heights},
    {"GET", "/v1/height", "getHeight", "terrain", "Terrain height at one place", true, false, true, answer_height,
     describe_height},
    {"POST", "/v1/features", "listFeatures", "terrain", "The craters of a detail in a region", true, true, true,
     answer_features, describe_features},
    {"GET", "/v1/datasets", "listDatasets", "terrain", "The catalogue of DEM tiles", false, false, false,
     answer_datasets, describe_datasets},
    {"POST", "/v1/verify/roundtrip", "verifyRoundTrip", "verification",
     "Extracts a DEM from camera views and compares it with the original", true, true, true, answer_verify_round_trip,
     describe_verify_round_trip},
    {"POST", "/v1/verify/mertis", "verifyMertis", "verification",
     "Simulates a thermal imaging spectrometer observing blackbodies", true, false, false, answer_verify_mertis,
     describe_verify_mertis},
    {"GET", "/openapi.json", "getOpenapi", "service", "This document", false, false, false, answer_openapi,
     describe_openapi},
};

}  // namespace

std::span<const Route> routes() { return kRoutes; }

std::optional<std::string_view> segment_of(const Route& route, std::string_view path) {
  const std::size_t open = route.path.find('{');
  if (open == std::string_view::npos) return path == route.path ? std::optional(std::string_view()) : std::nullopt;
  const std::string_view before = route.path.substr(0, open), after = route.path.substr(route.path.find('}') + 1);
  if (path.size() <= before.size() + after.size() || !path.starts_with(before) || !path.ends_with(after))
    return std::nullopt;
  const std::string_view segment = path.substr(before.size(), path.size() - before.size() - after.size());
  return segment.find('/') == std::string_view::npos ? std::optional(segment) : std::nullopt;
}

std::string allowed_methods(std::string_view path) {
  std::string methods;
  for (const Route& route : kRoutes)
    if (segment_of(route, path))
      methods += (methods.empty() ? "" : ", ") + std::string(route.method == "GET" ? "GET, HEAD" : route.method);
  return methods;
}

}  // namespace selenograph::api
