// Access control of GDAL's file systems. For dem/gdal/ only.
#pragma once

#include <optional>
#include <string>

#include "dem/files/files.h"

namespace selenograph::dem {

// Wraps GDAL's file systems: from then on only names permitted by allow_remote_files() are read, and reads are retried
// when a connection is lost. Call it once, after GDAL's drivers are registered.
void shut_file_systems();

// Restricts GDAL to regular local files for reading. Call it once.
void guard_local_files();

// Returns the state of an allowed file as its server reports it. Empty on an error: remote_trouble() gives the reason,
// if a server was asked.
std::optional<FileState> state_on_server(const std::string& name);

// Reason why this thread could not read a remote file.
struct RemoteTrouble {
  std::string file;
  std::string what;
  bool gone = false;  // true: the file is gone or has changed on the server; false: a temporary error
};
// Returns this thread's last error since forget_remote_trouble(), if any.
const std::optional<RemoteTrouble>& remote_trouble();
void forget_remote_trouble();
// Throws the recorded error as DataError or SystemFault, if any.
void throw_remote_trouble();

}  // namespace selenograph::dem
