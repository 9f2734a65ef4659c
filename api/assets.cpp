#include "api/assets.h"

#include <algorithm>
#include <filesystem>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "api/problem.h"
#include "dem/error.h"

namespace selenograph::api {
namespace {

namespace fs = std::filesystem;

// Names come from clients: nothing that could lead out of the folder.
bool is_plain(std::string_view name) {
  return !name.empty() && name.size() <= 100 && name.front() != '.' &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_' ||
                  c == '.';
         });
}

}  // namespace

std::shared_ptr<const engine::Atmosphere> Assets::atmosphere(std::string_view name) const {
  if (folder_.empty() || !is_plain(name)) return nullptr;
  const fs::path path = fs::path(folder_) / "atmospheres" / (std::string(name) + ".csv");
  std::error_code error;
  const auto modified = fs::last_write_time(path, error);
  if (error) return nullptr;
  const Stamp stamp{std::chrono::duration_cast<std::chrono::nanoseconds>(modified.time_since_epoch()).count(),
                    fs::file_size(path, error)};
  const std::lock_guard lock(mutex_);
  if (const auto found = atmospheres_.find(name); found != atmospheres_.end() && found->second.stamp == stamp)
    return found->second.atmosphere;
  std::shared_ptr<const engine::Atmosphere> read;
  try {
    read = std::make_shared<const engine::Atmosphere>(engine::Atmosphere::read(path.string()));
  } catch (const DataError& e) {
    throw RequestError("asset_error", e.what());
  }
  atmospheres_.insert_or_assign(std::string(name), Read{stamp, read});
  return read;
}

std::vector<std::string> Assets::names(std::string_view kind) const {
  std::vector<std::string> names;
  if (folder_.empty()) return names;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(fs::path(folder_) / kind, error))
    if (is_plain(entry.path().stem().string())) names.push_back(entry.path().stem().string());
  std::sort(names.begin(), names.end());
  return names;
}

std::uint64_t Assets::fingerprint(const engine::Atmosphere* atmosphere) {
  if (!atmosphere) return 0;
  const auto& rows = atmosphere->rows();
  return XXH3_64bits(rows.data(), rows.size() * sizeof rows[0]);
}

}  // namespace selenograph::api
