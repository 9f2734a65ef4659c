#include "server/commands/ask.h"

#include <fmt/format.h>

#include <chrono>
#include <utility>

#include "api/service.h"
#include "server/commands/output.h"
#include "server/commands/request_file.h"
#include "server/commands/start.h"

namespace selenograph::server {

api::Response ask_once(const TerrainSettings& terrain, const api::Limits& limits, const std::string& path,
                       const std::string& accept, std::string body) {
  api::Request request;
  request.method = "POST";
  request.path = path;
  request.headers = {{"accept", accept}, {"content-type", "application/json"}};
  request.body = std::move(body);
  const api::Service service(make_renderer(terrain), limits, terrain.assets_dir, mesh_options(terrain));
  request.received = std::chrono::steady_clock::now();
  return service.handle(request);
}

std::optional<api::Response> answer_file(const RequestSettings& settings, const std::string& path,
                                         const std::string& accept) {
  api::Response answer = ask_once(settings.terrain, settings.limits, path, accept, read_request(settings.request));
  if (answer.status != 200) {
    print_problem(answer);
    return std::nullopt;
  }
  write_whole(settings.output, answer.body);
  fmt::print(said_beside(settings.output), "{}: {} bytes\n", settings.output, answer.body.size());
  return answer;
}

}  // namespace selenograph::server
