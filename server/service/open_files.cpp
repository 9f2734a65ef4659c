#include "server/service/open_files.h"

#include <fmt/format.h>
#include <sys/resource.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

#include "server/http/connections.h"

namespace selenograph::server {
namespace {

constexpr long kOtherFiles = 256;  // DEM files and pyramids being read, the log, pipes, libraries

}  // namespace

long open_files_needed(int max_connections) { return Connections::max_sockets(max_connections) + kOtherFiles; }

void raise_open_files_limit(int max_connections) {
  const auto needed = static_cast<rlim_t>(open_files_needed(max_connections));
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0)
    throw std::runtime_error(fmt::format("cannot read the limit of open files: {}", std::strerror(errno)));
  if (limit.rlim_cur >= needed) return;
  if (limit.rlim_max < needed) {
    throw std::runtime_error(fmt::format(
        "--max-connections {} needs {} open files, but the process may have {} (ulimit -Hn): raise that limit, "
        "or allow fewer connections",
        max_connections, needed, limit.rlim_max));
  }
  limit.rlim_cur = needed;
  if (::setrlimit(RLIMIT_NOFILE, &limit) != 0)
    throw std::runtime_error(
        fmt::format("cannot raise the limit of open files to {}: {}", needed, std::strerror(errno)));
}

}  // namespace selenograph::server
