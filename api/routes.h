// Every call there is: what the dispatcher looks up and the API document lists.
#pragma once

#include <span>
#include <string_view>

namespace selenograph::api {

enum class Call { frames, rays, project, heights, height, datasets, verify_round_trip, verify_mertis, openapi };

struct Route {
  Call call;
  std::string_view method, path;
  // Costs render time: passes through the server's admission and takes a JSON body.
  bool admission;
  std::string_view operation_id, summary;
};

inline constexpr Route kRoutes[] = {
    {Call::frames, "POST", "/v1/frames", true, "renderFrame", "Renders the frame that a camera sees"},
    {Call::rays, "POST", "/v1/rays", true, "castRays", "Casts arbitrary rays: an altimeter or lidar"},
    {Call::project, "POST", "/v1/project", true, "projectPoints", "Says where landmarks appear in a camera's image"},
    {Call::heights, "POST", "/v1/heights", true, "getHeights", "Terrain heights at places"},
    {Call::height, "GET", "/v1/height", false, "getHeight", "Terrain height at one place"},
    {Call::datasets, "GET", "/v1/datasets", false, "listDatasets", "The catalogue of DEM tiles"},
    {Call::verify_round_trip, "POST", "/v1/verify/roundtrip", true, "verifyRoundTrip",
     "Extracts a DEM from what cameras see and compares it with its original"},
    {Call::verify_mertis, "POST", "/v1/verify/mertis", true, "verifyMertis",
     "What a thermal imaging spectrometer measures of blackbodies"},
    {Call::openapi, "GET", "/openapi.json", false, "getOpenapi", "This document"},
};

}  // namespace selenograph::api
