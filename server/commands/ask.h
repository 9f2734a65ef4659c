// One request to a service inside the command, without a socket.
#pragma once

#include <optional>
#include <string>

#include "api/message/message.h"
#include "server/commands/config.h"

namespace selenograph::server {

// Returns the limits of a command's own request: those of the formats. A user at the command line waits as long as the
// work takes.
api::Limits command_limits();

// Settings of a command that turns a request file into an answer file.
struct RequestSettings {
  TerrainSettings terrain;
  std::string request;  // path, "-": stdin
  std::string output;   // path; its extension is the format
};

// Sends the file's JSON by POST to `path`, writes the answer to the output and prints its size. Prints a refusal to
// stderr and returns nothing.
std::optional<api::Response> answer_file(const RequestSettings& settings, const std::string& path,
                                         const std::string& accept);

}  // namespace selenograph::server
