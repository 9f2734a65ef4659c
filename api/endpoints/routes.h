// The table of endpoints, used by the dispatcher and by the API document.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "api/endpoints/endpoint.h"
#include "api/endpoints/operation.h"

namespace selenograph::api {

struct Route {
  std::string_view method, path;  // "{hash}" in the path matches any one segment
  std::string_view operation_id, tag, summary;
  bool admission;      // true: expensive, passes through the server's admission
  bool negotiates;     // false: responds with JSON only
  bool reads_terrain;  // true: may fail because of unusable DEM files
  Response (*answer)(const EndpointContext& context);
  void (*describe)(Operation& operation);

  bool has_body() const { return method == "POST"; }  // a JSON body
};

// Each endpoint's answer and its description in the API document.
Response answer_frames(const EndpointContext& context);
void describe_frames(Operation& operation);
Response answer_frame_metadata(const EndpointContext& context);
void describe_frame_metadata(Operation& operation);
Response answer_maps(const EndpointContext& context);
void describe_maps(Operation& operation);
Response answer_horizons(const EndpointContext& context);
void describe_horizons(Operation& operation);
Response answer_illumination(const EndpointContext& context);
void describe_illumination(Operation& operation);
Response answer_rays(const EndpointContext& context);
void describe_rays(Operation& operation);
Response answer_project(const EndpointContext& context);
void describe_project(Operation& operation);
Response answer_sky(const EndpointContext& context);
void describe_sky(Operation& operation);
Response answer_lidar(const EndpointContext& context);
void describe_lidar(Operation& operation);
Response answer_limb(const EndpointContext& context);
void describe_limb(Operation& operation);
Response answer_heights(const EndpointContext& context);
void describe_heights(Operation& operation);
Response answer_height(const EndpointContext& context);
void describe_height(Operation& operation);
Response answer_features(const EndpointContext& context);
void describe_features(Operation& operation);
Response answer_datasets(const EndpointContext& context);
void describe_datasets(Operation& operation);
Response answer_verify_round_trip(const EndpointContext& context);
void describe_verify_round_trip(Operation& operation);
Response answer_verify_mertis(const EndpointContext& context);
void describe_verify_mertis(Operation& operation);
Response answer_openapi(const EndpointContext& context);
void describe_openapi(Operation& operation);

inline constexpr Route kRoutes[] = {
    {"POST", "/v1/frames", "renderFrame", "frames", "Renders the frame that a camera sees", true, true, true,
     answer_frames, describe_frames},
    {"GET", "/v1/frames/{hash}/meta", "getFrameMetadata", "frames",
     "Metadata of a frame, if it did not fit into the frame's header", false, false, false, answer_frame_metadata,
     describe_frame_metadata},
    {"POST", "/v1/maps", "renderMap", "maps", "Renders a map-projected product", true, true, true, answer_maps,
     describe_maps},
    {"POST", "/v1/horizons", "findHorizons", "maps", "Finds the horizons around the pixels of a map, or around places",
     true, true, true, answer_horizons, describe_horizons},
    {"POST", "/v1/illumination", "sumIllumination", "maps", "Sums the light of a time span above the horizons", true,
     true, true, answer_illumination, describe_illumination},
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

// Returns the variable segment of a path for a route with "{...}", or "" for a route without; no value if the path does
// not match the route.
std::optional<std::string_view> segment_of(const Route& route, std::string_view path);

// Returns the methods of a path for the header Allow. A path with GET also has HEAD, which the server answers without a
// body.
std::string allowed_methods(std::string_view path);

}  // namespace selenograph::api
