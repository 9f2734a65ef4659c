// Files of a folder in groups that belong together.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace selenograph::dem {

// Regular file in a folder, or a link to one.
struct FolderEntry {
  // The name up to its first dot, in lower case: "a.lbl", "A.IMG" and "a.tif.aux.xml" are one group.
  std::string_view group;
  std::string_view name;
  bool link = false;  // symbolic link to a file
};

// Listing of one folder: names only. A file is examined only if the folder does not give its type.
class FolderFiles {
 public:
  // Lists a folder and appends its subfolders to `folders`. Throws SystemFault when the system is at fault. Other
  // errors are returned by trouble(); entries listed before remain.
  explicit FolderFiles(std::string folder, std::vector<std::string>* folders = nullptr);
  FolderFiles(const FolderFiles&) = delete;
  FolderFiles& operator=(const FolderFiles&) = delete;

  const std::string& folder() const { return folder_; }
  // Returns the errno of an incomplete listing, or 0.
  int trouble() const { return trouble_; }
  // Returns the entries, sorted by group, then by name.
  const std::vector<FolderEntry>& entries() const { return entries_; }
  // Returns the entry of a name; null if it is not listed.
  const FolderEntry* find(std::string_view name) const;
  // Returns "folder/name".
  std::string path_of(std::string_view name) const;

  // Returns all entries of the same group: properties of a file may depend on any of them.
  std::span<const FolderEntry> group_of(const FolderEntry& entry) const;

 private:
  std::string folder_;
  int trouble_ = 0;
  std::string text_;  // storage of entries_
  std::vector<FolderEntry> entries_;
};

}  // namespace selenograph::dem
