// Requests from files, and what is wrong with them on stderr: for commands that answer as the service does.
#pragma once

#include <string>

#include "api/message/message.h"

namespace selenograph::server {

// "-": standard input. Throws std::runtime_error naming the file.
std::string read_request(const std::string& path);

// An answer that is none.
void print_problem(const api::Response& answer);

}  // namespace selenograph::server
