// Every endpoint there is: what the dispatcher looks up and the API document lists.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "api/endpoints/endpoint.h"
#include "api/endpoints/operation.h"

namespace selenograph::api {

struct Route {
  std::string_view method, path;  // "{hash}" in the path stands for any one segment
  std::string_view operation_id, tag, summary;
  bool admission;      // takes time: passes through the server's admission
  bool negotiates;     // false: answers JSON alone
  bool reads_terrain;  // whose files may be unusable
  Response (*answer)(const EndpointContext& context);
  void (*describe)(Operation& operation);

  bool has_body() const { return method == "POST"; }  // JSON
};

std::span<const Route> routes();

// What stands in a request's path where the route has "{...}", empty when it has none; nothing when the path isn't the
// route's.
std::optional<std::string_view> segment_of(const Route& route, std::string_view path);

// The methods of a path, as Allow lists them. Where there is GET the server answers HEAD with the same and no body.
std::string allowed_methods(std::string_view path);

}  // namespace selenograph::api
