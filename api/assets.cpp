#include "api/assets.h"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "api/problem.h"
#include "dem/error.h"

namespace selenograph::api {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxAssetDepth = 16;

// Names come from clients: nothing that could lead out of the folder.
bool is_plain(std::string_view name) {
  return !name.empty() && name.size() <= 100 && name.front() != '.' &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_' ||
                  c == '.';
         });
}

}  // namespace

template <typename T, typename Read>
std::shared_ptr<const T> Assets::find(Files<T>& files, const char* kind, const char* extension, std::string_view name,
                                      const Read& read) const {
  if (folder_.empty() || !is_plain(name)) return nullptr;
  const fs::path path = fs::path(folder_) / kind / (std::string(name) + extension);
  std::error_code error;
  const auto modified = fs::last_write_time(path, error);
  if (error) return nullptr;
  const Stamp stamp{std::chrono::duration_cast<std::chrono::nanoseconds>(modified.time_since_epoch()).count(),
                    fs::file_size(path, error)};
  const std::lock_guard lock(mutex_);
  if (const auto found = files.find(name); found != files.end() && found->second.stamp == stamp)
    return found->second.content;
  std::shared_ptr<const T> content;
  try {
    content = std::make_shared<const T>(read(path.string()));
  } catch (const DataError& e) {
    throw RequestError("asset_error", e.what());
  }
  files.insert_or_assign(std::string(name), Known<T>{stamp, content});
  return content;
}

std::shared_ptr<const engine::Atmosphere> Assets::atmosphere(std::string_view name) const {
  return find(atmospheres_, "atmospheres", ".csv", name, engine::Atmosphere::read);
}

std::shared_ptr<const Json> Assets::camera(std::string_view name) const {
  return find(cameras_, "cameras", ".json", name, [](const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    if (!file) throw DataError(path, "can't be read");
    try {
      Json json = parse_json(text, kMaxAssetDepth);
      if (!json.is_object()) throw DataError(path, "must be a JSON object");
      return json;
    } catch (const RequestError& e) {
      throw DataError(path, e.what());
    }
  });
}

std::shared_ptr<const engine::ObjectMesh> Assets::object(std::string_view name) const {
  for (const char* extension : {".obj", ".ply", ".gltf", ".glb"})
    if (auto mesh = find(objects_, "objects", extension, name, engine::ObjectMesh::read)) return mesh;
  return nullptr;
}

std::vector<std::string> Assets::names(std::string_view kind) const {
  std::vector<std::string> names;
  if (folder_.empty()) return names;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(fs::path(folder_) / kind, error))
    if (is_plain(entry.path().stem().string())) names.push_back(entry.path().stem().string());
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

std::string listed(const std::vector<std::string>& names) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
  return list.empty() ? "none" : list;
}

std::uint64_t Assets::fingerprint(const engine::Atmosphere* atmosphere) {
  if (!atmosphere) return 0;
  const auto& rows = atmosphere->rows();
  return XXH3_64bits(rows.data(), rows.size() * sizeof rows[0]);
}

}  // namespace selenograph::api
