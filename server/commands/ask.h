// One request to a service of the command's own, without a socket.
#pragma once

#include <string>

#include "api/message/message.h"
#include "server/commands/config.h"

namespace selenograph::server {

// The very answer that a service would give to a POST of JSON.
api::Response ask_once(const TerrainSettings& terrain, const api::Limits& limits, const std::string& path,
                       const std::string& accept, std::string body);

}  // namespace selenograph::server
