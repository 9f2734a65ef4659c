// What stands before GDAL's file systems. Within dem/gdal/ only.
#pragma once

#include <optional>
#include <string>

namespace selenograph::dem {

// Once, after GDAL's drivers are registered: from then on only what allow_remote_files() names is read, and what is
// read again when a connection is lost.
void shut_file_systems();

// Once, too: of this machine's files only regular ones are opened for reading.
void guard_local_files();

// Why this thread could not read a remote file, in the end.
struct RemoteTrouble {
  std::string file;
  std::string what;
  bool gone = false;  // the server answers, and has no such file, or another one by now; else a passing fault
};
// Of the last one since forget_remote_trouble(), if any.
const std::optional<RemoteTrouble>& remote_trouble();
void forget_remote_trouble();
// Throws what there is as DataError or SystemFault, if any.
void throw_remote_trouble();

}  // namespace selenograph::dem
