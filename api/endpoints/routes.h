// The table of endpoints, used by the dispatcher and by the API document.
#pragma once

#include <optional>
#include <span>
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

std::span<const Route> routes();

// Returns the variable segment of a path for a route with "{...}", or "" for a route without; no value if the path does
// not match the route.
std::optional<std::string_view> segment_of(const Route& route, std::string_view path);

// Returns the methods of a path for the header Allow. A path with GET also has HEAD, which the server answers without a
// body.
std::string allowed_methods(std::string_view path);

}  // namespace selenograph::api
