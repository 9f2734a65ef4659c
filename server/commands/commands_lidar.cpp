// `selenograph lidar`: writes the bytes that POST /v1/lidar answers, without a socket.
#include <filesystem>
#include <stdexcept>

#include "server/commands/ask.h"
#include "server/commands/commands.h"
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
  return answer_file(settings, "/v1/lidar", lidar_media_type(settings.output)) ? 0 : 1;
}

}  // namespace selenograph::server
