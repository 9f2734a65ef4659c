// Files on a network, as their servers describe them.
#pragma once

#include <string>

#include "dem/files/files.h"

namespace selenograph::dem {

// What the server says of a file that is allowed; modified_ns is 0 where it says nothing about time. Throws DataError
// where it isn't allowed, or not there, and SystemFault where the server can't be reached or fails.
FileState remote_state(const std::string& path);

}  // namespace selenograph::dem
