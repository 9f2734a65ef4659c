// Every endpoint there is: what the dispatcher looks up and the API document lists.
#pragma once

#include <span>
#include <string_view>

namespace selenograph::api {

enum class Endpoint { frames, rays, project, heights, height, datasets, verify_round_trip, verify_mertis, openapi };

struct Route {
  Endpoint endpoint;
  std::string_view method, path;
  // Costs render time: passes through the server's admission and takes a JSON body.
  bool admission;
  std::string_view operation_id, summary;
};

inline constexpr Route kRoutes[] = {
    {Endpoint::frames, "POST", "/v1/frames", true, "renderFrame", "Renders the frame that a camera sees"},
    {Endpoint::rays, "POST", "/v1/rays", true, "castRays", "Casts arbitrary rays: an altimeter or lidar"},
    {Endpoint::project, "POST", "/v1/project", true, "projectPoints",
     "Says where landmarks appear in a camera's image"},
    {Endpoint::heights, "POST", "/v1/heights", true, "getHeights", "Terrain heights at places"},
    {Endpoint::height, "GET", "/v1/height", false, "getHeight", "Terrain height at one place"},
    {Endpoint::datasets, "GET", "/v1/datasets", false, "listDatasets", "The catalogue of DEM tiles"},
    {Endpoint::verify_round_trip, "POST", "/v1/verify/roundtrip", true, "verifyRoundTrip",
     "Extracts a DEM from what cameras see and compares it with its original"},
    {Endpoint::verify_mertis, "POST", "/v1/verify/mertis", true, "verifyMertis",
     "What a thermal imaging spectrometer measures of blackbodies"},
    {Endpoint::openapi, "GET", "/openapi.json", false, "getOpenapi", "This document"},
};

}  // namespace selenograph::api
