#include "dem/gdal/remote_names.h"

#include <algorithm>

namespace selenograph::dem {
namespace {

std::vector<std::string>& allowed_prefixes() {
  static std::vector<std::string> prefixes;
  return prefixes;
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
  return name.find("/../") == std::string_view::npos &&
         std::any_of(prefixes.begin(), prefixes.end(),
                     [&](const std::string& prefix) { return is_at_or_above(prefix, name); });
}

}  // namespace selenograph::dem
