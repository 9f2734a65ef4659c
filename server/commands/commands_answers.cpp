// Commands that write the bytes of one endpoint's answer, without a socket: `selenograph lidar`, `horizons` and
// `illumination`.
#include <filesystem>
#include <initializer_list>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

#include "server/commands/ask.h"
#include "server/commands/commands.h"
#include "server/commands/start.h"

namespace selenograph::server {
namespace {

constexpr std::pair<std::string_view, std::string_view> kMediaTypes[] = {
    {".tif", "image/tiff"}, {".npz", "application/x-npz"}, {".json", "application/json"}, {".csv", "text/csv"}};

// Writes the answer of an endpoint in the format of the output's extension, which must be one of these. Returns the
// exit status.
int write_answer(const RequestSettings& settings, const std::string& path,
                 std::initializer_list<std::string_view> extensions) {
  set_up_log(settings.terrain.log_level);
  const std::string extension = std::filesystem::path(settings.output).extension().string();
  std::string names;
  for (const std::string_view name : extensions) {
    names += (names.empty() ? "" : ", ") + std::string(name);
    if (name != extension) continue;
    for (const auto& [of, media_type] : kMediaTypes)
      if (of == name) return answer_file(settings, path, std::string(media_type)) ? 0 : 1;
  }
  throw std::runtime_error(settings.output + ": the name must end in one of " + names);
}

}  // namespace

int lidar(const LidarSettings& settings) { return write_answer(settings, "/v1/lidar", {".npz", ".json"}); }

int horizons(const HorizonsSettings& settings) {
  return write_answer(settings, "/v1/horizons", {".tif", ".npz", ".json"});
}

int illumination(const IlluminationSettings& settings) {
  return write_answer(settings, "/v1/illumination", {".tif", ".npz", ".json", ".csv"});
}

}  // namespace selenograph::server
