// `selenograph lidar`: writes the bytes that POST /v1/lidar answers, without a socket.
#include <filesystem>
#include <stdexcept>
#include <string>

#include "server/commands/ask.h"
#include "server/commands/commands.h"
#include "server/commands/start.h"

namespace selenograph::server {

int lidar(const LidarSettings& settings) {
  set_up_log(settings.terrain.log_level);
  const std::string extension = std::filesystem::path(settings.output).extension().string();
  if (extension != ".npz" && extension != ".json")
    throw std::runtime_error(settings.output + ": the name must end in one of .npz, .json");
  const char* const media_type = extension == ".npz" ? "application/x-npz" : "application/json";
  return answer_file(settings, "/v1/lidar", media_type) ? 0 : 1;
}

}  // namespace selenograph::server
