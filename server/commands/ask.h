// One request to a service of the command's own, without a socket.
#pragma once

#include <optional>
#include <string>

#include "api/message/message.h"
#include "server/commands/config.h"

namespace selenograph::server {

// The very answer that a service would give to a POST of JSON.
api::Response ask_once(const TerrainSettings& terrain, const api::Limits& limits, const std::string& path,
                       const std::string& accept, std::string body);

// A command that answers a request's file with a file.
struct RequestSettings {
  TerrainSettings terrain;
  api::Limits limits;
  std::string request;  // path, "-": stdin
  std::string output;   // path; its extension is the format
};

// Writes the answer, and says so beside it. Empty: a refusal, which is printed.
std::optional<api::Response> answer_file(const RequestSettings& settings, const std::string& path,
                                         const std::string& accept);

}  // namespace selenograph::server
