// The files of a folder, and whether those that belong together are still what they were.
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

// A file's size and times as a number, and when it last changed by its file system's clock. What is not there has a
// stamp, too.
struct FileStamp {
  std::uint64_t hash = 0;
  std::int64_t changed_ns = 0;
};
// Empty: the system can't tell.
std::optional<FileStamp> stamp_of(const std::string& path);

// A listing of one folder: names only, no file is looked at but where the folder doesn't say what is a file.
class FolderFiles {
 public:
  // Folders within are appended to `folders`. Throws SystemFault where the system is at fault; any other trouble is
  // told by trouble(), and what was listed until then stays.
  explicit FolderFiles(std::string folder, std::vector<std::string>* folders = nullptr);
  FolderFiles(const FolderFiles&) = delete;
  FolderFiles& operator=(const FolderFiles&) = delete;

  const std::string& folder() const { return folder_; }
  // An errno, or 0.
  int trouble() const { return trouble_; }
  // By group, then by name.
  const std::vector<FolderEntry>& entries() const { return entries_; }
  // Null: not listed.
  const FolderEntry* find(std::string_view name) const;
  // "folder/name".
  std::string path_of(std::string_view name) const;

  // All that bear the name of one of entries(): what is known of it may depend on any of them.
  std::span<const FolderEntry> group_of(const FolderEntry& entry) const;
  // Changes whenever one of them comes, goes or changes. Empty: the system can't tell. Safe to call concurrently.
  std::optional<FileStamp> stamp(const FolderEntry& entry) const;

 private:
  std::string folder_;
  int trouble_ = 0;
  std::string text_;  // that entries_ point into
  std::vector<FolderEntry> entries_;
};

}  // namespace selenograph::dem
