// Requests from files, their limits, and their problems on stderr, for commands with the answers of the service.
#pragma once

#include <string>

#include "api/message/limits.h"
#include "api/message/message.h"
#include "api/message/problem.h"
#include "api/requests/frame_json.h"
#include "engine/renderer.h"

namespace selenograph::server {

// Returns the limits of a command's own request: those of the formats. A user at the command line waits as long as the
// work takes.
api::Limits command_limits();

// Reads a file; "-": standard input. Throws std::runtime_error naming the file.
std::string read_request(const std::string& path);

// Returns a refusal's text, and below it the findings that it does not name, one a line.
std::string with_findings(const api::RequestError& error);

// Returns the terrain's heights for poses above the ground, as /v1/heights answers them. The renderer must outlive
// them.
api::GroundHeights ground_heights(const engine::Renderer& renderer);

// Prints the problem document of a failed response.
void print_problem(const api::Response& answer);

}  // namespace selenograph::server
