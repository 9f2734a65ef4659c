// State of remote files.
#pragma once

#include <string>

#include "dem/files/files.h"

namespace selenograph::dem {

// State of an allowed file as reported by the server; modified_ns is 0 if it reports no time. Throws DataError when the
// file is not allowed or missing, SystemFault when the server cannot be reached or fails.
FileState remote_state(const std::string& path);

}  // namespace selenograph::dem
