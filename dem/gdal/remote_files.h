// State of remote files.
#pragma once

#include <string>

#include "dem/files/files.h"

namespace selenograph::dem {

// Returns the state of an allowed file as reported by the server; its identity is that of the ETag. Throws DataError
// when the file is not allowed or missing, SystemFault when the server cannot be reached or fails.
FileState remote_state(const std::string& path);

}  // namespace selenograph::dem
