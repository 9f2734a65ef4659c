// Reads requests from files and prints problems to stderr, for commands with the answers of the service.
#pragma once

#include <string>

#include "api/message/message.h"

namespace selenograph::server {

// Reads a file; "-": standard input. Throws std::runtime_error naming the file.
std::string read_request(const std::string& path);

// Prints the problem document of a failed response.
void print_problem(const api::Response& answer);

}  // namespace selenograph::server
