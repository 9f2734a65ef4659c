// Limit of open files and sockets.
#pragma once

namespace selenograph::server {

// Raises the soft limit (RLIMIT_NOFILE) to what `max_connections` need, plus DEM files, pyramids and the service's own
// files. Throws std::runtime_error naming both numbers when the hard limit is lower: a service that runs out of
// descriptors fails wherever it happens to open the next file.
void raise_open_files_limit(int max_connections);

// Number of descriptors needed: connections, those about to end, and everything else.
long open_files_needed(int max_connections);

}  // namespace selenograph::server
