// What an opening of the catalogue found, kept on the disk for the next one.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "dem/files/raster_info.h"

namespace selenograph::dem {

// One file that was looked at, and all that the finding depends on: as long as the stamps are the same, so is it.
struct SavedFile {
  std::string path;
  std::uint64_t stamp = 0;  // of its group (folder_files.h); of a remote file, its own
  std::vector<std::pair<std::string, std::uint64_t>> others;  // files of other names, and their stamps
  std::optional<RasterInfo> raster;                           // nothing: it is about something else than heights
};

// "catalogue/NUMBER.sgc" in the cache folder, one for each list of paths; a file that can't be read, is damaged or was
// written by another version is as good as none, and replaced.
class SavedCatalogue {
 public:
  using Log = std::function<void(const std::string&)>;

  SavedCatalogue() = default;  // that keeps nothing
  SavedCatalogue(const SavedCatalogue&) = delete;
  SavedCatalogue& operator=(const SavedCatalogue&) = delete;

  // What was kept for these paths; once, before all else. `cache_dir`: empty: nothing is read or kept. Throws nothing
  // but std::bad_alloc.
  void read(const std::string& cache_dir, const std::vector<std::string>& paths, Log log);

  std::size_t size() const { return files_.size(); }
  // Null: nothing is known of that file. Safe to call concurrently.
  SavedFile* find(std::string_view path);

  // Keeps these in place of what was read: whole, or not at all. A folder that can't be written is told to the log.
  void replace(const std::vector<const SavedFile*>& files);

 private:
  std::string path_, key_;
  Log log_;
  std::vector<SavedFile> files_;
  std::unordered_map<std::string_view, SavedFile*> by_path_;
};

}  // namespace selenograph::dem
