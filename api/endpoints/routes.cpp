#include "api/endpoints/routes.h"

namespace selenograph::api {

std::optional<std::string_view> segment_of(const Route& route, std::string_view path) {
  // A path with a variable segment is compared before its '{' and behind its '}'.
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
