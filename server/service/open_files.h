// How many files and sockets the process may have open.
#pragma once

namespace selenograph::server {

// Raises the soft limit (RLIMIT_NOFILE) to what so many connections need beside DEM files, pyramids and the service's
// own. Throws std::runtime_error naming both figures when the hard limit is below that: a service that runs out of
// descriptors fails wherever it happens to open the next file.
void raise_open_files_limit(int max_connections);

// The need: descriptors of connections, of those that are about to end, and of everything else.
long open_files_needed(int max_connections);

}  // namespace selenograph::server
