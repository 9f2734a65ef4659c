#include "server/commands/ask.h"

#include <fmt/format.h>

#include <chrono>
#include <cstdint>

#include "api/service.h"
#include "server/commands/output.h"
#include "server/commands/request_file.h"
#include "server/commands/start.h"

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

std::optional<api::Response> answer_file(const RequestSettings& settings, const std::string& path,
                                         const std::string& accept) {
  const TerrainSettings& terrain = settings.terrain;
  api::Request request;
  request.method = "POST";
  request.path = path;
  request.headers = {{"accept", accept}, {"content-type", "application/json"}};
  request.body = read_request(settings.request);
  const api::Service service(make_renderer(terrain), command_limits(), terrain.assets_dir, mesh_options(terrain));
  request.received = std::chrono::steady_clock::now();
  api::Response answer = service.handle(request);
  if (answer.status != 200) {
    print_problem(answer);
    return std::nullopt;
  }
  write_whole(settings.output, answer.body);
  fmt::print(stream_for_messages(settings.output), "{}: {} bytes\n", settings.output, answer.body.size());
  return answer;
}

}  // namespace selenograph::server
