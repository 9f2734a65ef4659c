// The files of a folder in groups that belong together, and whether they have changed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace selenograph::dem {

struct FolderEntry {
  std::string_view
      group;  // the name up to its first dot, in lower case: "a.lbl", "A.IMG", "a.tif.aux.xml" are one group
  std::string_view name;
  bool link = false;  // symbolic, to a file
};

// Stamp of a file's state and kind, and its last change by the file system's clock. Missing files have a stamp, too.
struct FileStamp {
  std::uint64_t hash = 0;
  std::int64_t changed_ns = 0;
};
// Empty when the system cannot tell.
std::optional<FileStamp> stamp_of(const std::string& path);

// A listing of one folder: names only; a file is examined only if the folder does not give its type.
class FolderFiles {
 public:
  // Appends subfolders to `folders`. Throws SystemFault when the system is at fault; other errors are returned by
  // trouble(), and entries listed before remain.
  explicit FolderFiles(std::string folder, std::vector<std::string>* folders = nullptr);
  FolderFiles(const FolderFiles&) = delete;
  FolderFiles& operator=(const FolderFiles&) = delete;

  const std::string& folder() const { return folder_; }
  // An errno, or 0.
  int trouble() const { return trouble_; }
  // Sorted by group, then by name.
  const std::vector<FolderEntry>& entries() const { return entries_; }
  // Null if not listed.
  const FolderEntry* find(std::string_view name) const;
  // "folder/name".
  std::string path_of(std::string_view name) const;

  // All entries of the same group: properties of a file may depend on any of them.
  std::span<const FolderEntry> group_of(const FolderEntry& entry) const;
  // Changes whenever one of them is added, removed or changed. Empty when the system cannot tell. Thread-safe.
  std::optional<FileStamp> stamp(const FolderEntry& entry) const;

 private:
  std::string folder_;
  int trouble_ = 0;
  std::string text_;  // storage of entries_
  std::vector<FolderEntry> entries_;
};

}  // namespace selenograph::dem
