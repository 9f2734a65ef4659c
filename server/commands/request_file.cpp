#include "server/commands/request_file.h"

#include <fmt/format.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <iostream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "dem/files/files.h"

namespace selenograph::server {

api::Limits command_limits() {
  return {.max_body_bytes = std::size_t{1} << 30,
          .max_image_side = 65535,
          .max_image_pixels = std::int64_t{1} << 28,
          .max_map_pixels = std::int64_t{1} << 28,
          .max_samples_per_pixel = 65536,
          .max_rays = 1 << 24,
          .max_lidar_rays = std::int64_t{1} << 32,
          .default_deadline = std::chrono::hours(24 * 365)};
}

std::string read_request(const std::string& path) {
  if (path == "-") return {std::istreambuf_iterator<char>(std::cin), {}};
  return dem::read_whole(path);
}

std::string with_findings(const api::RequestError& error) {
  const std::string text = error.what();
  std::string out = text;
  for (const api::Finding& f : error.findings()) {
    const std::string line = fmt::format("{}: {}", f.pointer, f.detail);
    if (!text.starts_with(line)) out += "\n  " + line;
  }
  return out;
}

api::GroundHeights ground_heights(const engine::Renderer& renderer) {
  return [&renderer](const std::shared_ptr<const dem::Detail>& detail, double lat_deg, double lon_deg) {
    return renderer.terrain_with(detail)->height(lat_deg, lon_deg).height_m;
  };
}

void print_problem(const api::Response& answer) {
  const auto problem = nlohmann::json::parse(answer.body, nullptr, false);
  if (!problem.is_object()) {
    fmt::print(stderr, "error: status {}\n", answer.status);
    return;
  }
  fmt::print(stderr, "error: {}: {}\n", problem.value("title", ""), problem.value("detail", ""));
  for (const auto& finding : problem.value("errors", nlohmann::json::array())) {
    fmt::print(stderr, "  {}: {}\n", finding.value("pointer", ""), finding.value("detail", ""));
  }
}

}  // namespace selenograph::server
