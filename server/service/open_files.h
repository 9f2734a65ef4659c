// Limit of open files and sockets.
#pragma once

namespace selenograph::server {

// Raises the soft limit (RLIMIT_NOFILE) to open_files_needed(). Throws std::runtime_error naming both numbers when the
// hard limit is lower: a service that runs out of descriptors later fails at whatever file it opens next.
void raise_open_files_limit(int max_connections);

// Returns the number of descriptors for connections, for those about to end, and for all files of the service.
long open_files_needed(int max_connections);

}  // namespace selenograph::server
