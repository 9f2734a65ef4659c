#include "dem/gdal/remote_names.h"

#include <algorithm>

#include "dem/files/names.h"

namespace selenograph::dem {
namespace {

std::vector<std::string>& allowed_prefixes() {
  static std::vector<std::string> prefixes;
  return prefixes;
}

// A path that a server, or libcurl, would shorten to one outside of the prefix that allows it.
bool climbs(std::string_view name) {
  std::string plain;
  for (std::size_t i = 0; i < name.size(); ++i) {
    const std::string code = lower(name.substr(i, 3));
    const bool dot = code == "%2e", slash = code == "%2f" || code == "%5c";
    plain += dot ? '.' : slash || name[i] == '\\' ? '/' : name[i];
    if (dot || slash) i += 2;
  }
  return plain.find("/../") != std::string::npos || plain.ends_with("/..") || plain.find("%25") != std::string::npos;
}

}  // namespace

void allow_remote_files(const std::vector<std::string>& prefixes) { allowed_prefixes() = prefixes; }

bool is_remote(const std::string& path) { return path.starts_with("/vsi"); }

bool is_allowed(std::string_view name) {
  const std::vector<std::string>& prefixes = allowed_prefixes();
  return std::any_of(prefixes.begin(), prefixes.end(),
                     [&](const std::string& p) { return !p.empty() && name.starts_with(p); }) &&
         !climbs(name);
}

}  // namespace selenograph::dem
