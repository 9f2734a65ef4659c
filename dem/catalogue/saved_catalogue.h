// Results of opening a catalogue, saved on disk for the next opening.
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

// Result of inspecting one file, with everything that it depends on. It is valid as long as the stamps are the same.
struct SavedFile {
  std::string path;
  std::uint64_t stamp = 0;                                    // stamp of the file's group (folder_files.h)
  std::vector<std::pair<std::string, std::uint64_t>> others;  // other files that it was read from, and their stamps
  std::optional<RasterInfo> raster;                           // empty: the file does not contain heights
};

// File "catalogue/NUMBER.sgc" in the cache folder, one for each list of paths. A file that cannot be read, is damaged
// or was written by another version is ignored and replaced.
class SavedCatalogue {
 public:
  using Log = std::function<void(const std::string&)>;

  SavedCatalogue() = default;  // saves nothing
  SavedCatalogue(const SavedCatalogue&) = delete;
  SavedCatalogue& operator=(const SavedCatalogue&) = delete;

  // Reads the file for these paths; call it once, before the other functions. If
  // `cache_dir` is empty, nothing is read or saved. Throws nothing but std::bad_alloc.
  void read(const std::string& cache_dir, const std::vector<std::string>& paths, Log log);

  std::size_t size() const { return files_.size(); }
  // Returns the saved result for a file, or null. Thread-safe.
  SavedFile* find(std::string_view path);

  // Replaces the saved files, atomically. A folder that cannot be written is reported to the log.
  void replace(const std::vector<const SavedFile*>& files);

 private:
  std::string path_, key_;
  Log log_;
  std::vector<SavedFile> files_;
  std::unordered_map<std::string_view, SavedFile*> by_path_;
};

}  // namespace selenograph::dem
