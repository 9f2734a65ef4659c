#include "dem/gdal/remote_names.h"

#include <algorithm>

#include "dem/base/names.h"

namespace selenograph::dem {
namespace {

std::vector<std::string>& allowed_prefixes() {
  static std::vector<std::string> prefixes;
  return prefixes;
}

// Returns true for a path that a server, or libcurl, would shorten to one outside of the allowed prefix. Decodes %2e,
// %2f and %5c.
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

// Returns true if a prefix is a name or a folder above it. Compared by characters alone, "http://host:21" would allow
// "http://host:2115/", and "http://host" would allow "http://host@elsewhere/".
bool is_at_or_above(std::string_view prefix, std::string_view name) {
  return !prefix.empty() && name.starts_with(prefix) &&
         (prefix.ends_with('/') || name.size() == prefix.size() || name[prefix.size()] == '/');
}

}  // namespace

void allow_remote_files(const std::vector<std::string>& prefixes) { allowed_prefixes() = prefixes; }

bool is_remote(const std::string& path) { return path.starts_with("/vsi"); }

bool is_allowed(std::string_view name) {
  const std::vector<std::string>& prefixes = allowed_prefixes();
  return std::any_of(prefixes.begin(), prefixes.end(),
                     [&](const std::string& prefix) { return is_at_or_above(prefix, name); }) &&
         !climbs(name);
}

std::string redirected_name(const std::string& name, const std::string& location) {
  const std::string file_system = "/vsicurl/";
  if (location.find("://") != std::string::npos) return file_system + location;
  const std::size_t scheme_end = name.find("://");
  if (scheme_end == std::string::npos) return file_system + location;
  if (location.starts_with("//")) return name.substr(0, scheme_end + 1) + location;
  if (location.starts_with('/')) return name.substr(0, name.find('/', scheme_end + 3)) + location;
  return name.substr(0, name.rfind('/') + 1) + location;
}

}  // namespace selenograph::dem
