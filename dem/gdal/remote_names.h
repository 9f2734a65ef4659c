// Names in GDAL's network file systems (/vsicurl/, /vsis3/ and the like), and access control by prefix.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace selenograph::dem {

// Allows the files and folders of these names, and all that lies below them, to be read by themselves and as sources of
// VRTs, e.g. "/vsicurl/https://example.org/dem". Call before anything is opened; empty, the default: none.
void allow_remote_files(const std::vector<std::string>& prefixes);

// Whether a name refers to a remote file or a file in an archive, in GDAL's notation.
bool is_remote(const std::string& path);
// Whether a name has an allowed prefix and does not leave it by "..".
bool is_allowed(std::string_view name);

// Name of the file to which a server redirects: `location` as in its answer's header, for a request of `name`.
std::string redirected_name(const std::string& name, const std::string& location);

}  // namespace selenograph::dem
