// Every endpoint there is: what the dispatcher looks up and the API document lists.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string_view>

namespace selenograph::api {

enum class Endpoint {
  frames,
  frame_metadata,
  maps,
  rays,
  project,
  heights,
  height,
  features,
  datasets,
  verify_round_trip,
  verify_mertis,
  openapi
};

struct Route {
  Endpoint endpoint;
  std::string_view method, path;                      // "{hash}" in the path stands for any one segment
  bool admission;                                     // takes time: passes through the server's admission
  bool has_body() const { return method == "POST"; }  // JSON
  std::string_view operation_id, summary;
};

inline constexpr Route kRoutes[] = {
    {Endpoint::frames, "POST", "/v1/frames", true, "renderFrame", "Renders the frame that a camera sees"},
    {Endpoint::frame_metadata, "GET", "/v1/frames/{hash}/meta", false, "getFrameMetadata",
     "The metadata of a frame whose header has no room for it"},
    {Endpoint::maps, "POST", "/v1/maps", true, "renderMap", "Renders a map-projected product"},
    {Endpoint::rays, "POST", "/v1/rays", true, "castRays", "Casts arbitrary rays: an altimeter or lidar"},
    {Endpoint::project, "POST", "/v1/project", true, "projectPoints",
     "Says where landmarks appear in a camera's image"},
    {Endpoint::heights, "POST", "/v1/heights", true, "getHeights", "Terrain heights at places"},
    {Endpoint::height, "GET", "/v1/height", true, "getHeight", "Terrain height at one place"},
    {Endpoint::features, "POST", "/v1/features", true, "listFeatures", "The craters of a detail in a region"},
    {Endpoint::datasets, "GET", "/v1/datasets", false, "listDatasets", "The catalogue of DEM tiles"},
    {Endpoint::verify_round_trip, "POST", "/v1/verify/roundtrip", true, "verifyRoundTrip",
     "Extracts a DEM from what cameras see and compares it with its original"},
    {Endpoint::verify_mertis, "POST", "/v1/verify/mertis", true, "verifyMertis",
     "What a thermal imaging spectrometer measures of blackbodies"},
    {Endpoint::openapi, "GET", "/openapi.json", false, "getOpenapi", "This document"},
};

// What stands in a request's path where the route has "{...}", empty when it has none; nothing when the path isn't the
// route's.
constexpr std::optional<std::string_view> segment_of(const Route& route, std::string_view path) {
  const std::size_t open = route.path.find('{');
  if (open == std::string_view::npos) return path == route.path ? std::optional(std::string_view()) : std::nullopt;
  const std::string_view before = route.path.substr(0, open), after = route.path.substr(route.path.find('}') + 1);
  if (path.size() <= before.size() + after.size() || !path.starts_with(before) || !path.ends_with(after))
    return std::nullopt;
  const std::string_view segment = path.substr(before.size(), path.size() - before.size() - after.size());
  return segment.find('/') == std::string_view::npos ? std::optional(segment) : std::nullopt;
}

}  // namespace selenograph::api
