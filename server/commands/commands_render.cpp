// `selenograph render`: writes the bytes that POST /v1/frames answers, without a socket.
#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <stdexcept>

#include "api/encode/negotiate.h"
#include "api/json/json_reader.h"
#include "server/commands/ask.h"
#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/start.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

std::string media_type_of_frame(const std::string& output) {
  std::string extension = fs::path(output).extension().string();
  if (!extension.empty()) extension.erase(0, 1);
  if (extension == "tif") extension = "tiff";
  std::string extensions;
  for (const api::Representation& r : api::representations()) {
    if (r.extension == extension) return std::string(r.media_type);
    extensions += (extensions.empty() ? "." : ", .") + std::string(r.extension);
  }
  throw std::runtime_error(output + ": the name must end in one of " + extensions);
}

}  // namespace

int render(const RenderSettings& settings) {
  set_up_log(settings.terrain.log_level);
  const auto answer = answer_file(settings, "/v1/frames", media_type_of_frame(settings.output));
  if (!answer) return 1;
  std::FILE* messages = stream_for_messages(settings.output);
  for (const auto& [name, value] : answer->headers) {
    if (name == "Selenograph-Warnings")
      for (const api::Json& text : api::Json::parse(value))
        fmt::print(messages, "{}: warning: {}\n", settings.output, text.get<std::string>());
    if (name == "Selenograph-Missing-Fraction")
      fmt::print(messages,
                 "{}: a share of {} of the pixels looks at the Moon outside the data: black, NaN or 65535 there\n",
                 settings.output, value);
  }
  return 0;
}

}  // namespace selenograph::server
