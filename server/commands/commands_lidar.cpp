// `selenograph lidar`: a scan, the very bytes that POST /v1/lidar would answer.
#include <fmt/format.h>

#include <filesystem>
#include <stdexcept>

#include "server/commands/ask.h"
#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/request_file.h"
#include "server/commands/start.h"

namespace selenograph::server {
namespace {

std::string lidar_media_type(const std::string& output) {
  const std::string extension = std::filesystem::path(output).extension().string();
  if (extension == ".npz") return "application/x-npz";
  if (extension == ".json") return "application/json";
  throw std::runtime_error(output + ": the name must end in .npz or .json");
}

}  // namespace

int lidar(const LidarSettings& settings) {
  set_up_log(settings.terrain.log_level);
  const api::Response answer = ask_once(settings.terrain, settings.limits, "/v1/lidar",
                                        lidar_media_type(settings.output), read_request(settings.request));
  if (answer.status != 200) {
    print_problem(answer);
    return 1;
  }
  write_whole(settings.output, answer.body);
  fmt::print("{}: {} bytes\n", settings.output, answer.body.size());
  return 0;
}

}  // namespace selenograph::server
