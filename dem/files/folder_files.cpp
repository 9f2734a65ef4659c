#include "dem/files/folder_files.h"

#include <dirent.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <iterator>
#include <memory>
#include <tuple>
#include <utility>

#include "dem/base/error.h"
#include "dem/base/names.h"
#include "dem/files/files.h"

namespace selenograph::dem {
namespace {

// Returns the name of a file's group: the files that differ only in what follows the first dot.
std::string group_name(std::string_view name) { return lower(name.substr(0, name.find('.'))); }

// Returns the type of a file that the folder does not give; 0 if it is unknown. `follows_links`: of a link's target.
mode_t type_of(const std::string& path, bool follows_links) {
  struct stat s {};
  const int failed = follows_links ? ::stat(path.c_str(), &s) : ::lstat(path.c_str(), &s);
  return failed ? 0 : s.st_mode & S_IFMT;
}

}  // namespace

FolderFiles::FolderFiles(std::string folder, std::vector<std::string>* folders) : folder_(std::move(folder)) {
  const std::unique_ptr<DIR, int (*)(DIR*)> listing(::opendir(folder_.empty() ? "." : folder_.c_str()), ::closedir);
  if (!listing) {
    trouble_ = errno;
    if (is_system_fault(trouble_)) throw SystemFault(folder_, trouble_);
    return;
  }
  // Offsets in text_: text_ moves while it grows, so views are made at the end.
  struct NameOffsets {
    std::size_t group, name, end;
    bool link;
  };
  std::vector<NameOffsets> offsets;
  for (;;) {
    errno = 0;
    const dirent* entry = ::readdir(listing.get());
    if (!entry) break;
    const std::string_view name = entry->d_name;
    if (name == "." || name == "..") continue;
    unsigned char type = entry->d_type;
    if (type == DT_UNKNOWN) type = static_cast<unsigned char>(IFTODT(type_of(path_of(name), false)));
    if (type == DT_DIR && folders) folders->push_back(path_of(name));
    const bool link = type == DT_LNK;
    if (type != DT_REG && !(link && type_of(path_of(name), true) == S_IFREG)) continue;
    const std::size_t group = text_.size();
    text_ += group_name(name);
    offsets.push_back({group, text_.size(), text_.size() + name.size(), link});
    text_ += name;
  }
  trouble_ = errno;
  if (is_system_fault(trouble_)) throw SystemFault(folder_, trouble_);
  entries_.reserve(offsets.size());
  const std::string_view text = text_;
  for (const NameOffsets& p : offsets)
    entries_.push_back({text.substr(p.group, p.name - p.group), text.substr(p.name, p.end - p.name), p.link});
  std::sort(entries_.begin(), entries_.end(), [](const FolderEntry& a, const FolderEntry& b) {
    return std::tie(a.group, a.name) < std::tie(b.group, b.name);
  });
}

std::string FolderFiles::path_of(std::string_view name) const {
  std::string path = folder_;
  if (!path.empty() && path.back() != '/') path += '/';
  return path.append(name);
}

const FolderEntry* FolderFiles::find(std::string_view name) const {
  const std::string group = group_name(name);
  const FolderEntry key{group, name};
  const auto found = std::lower_bound(
      entries_.begin(), entries_.end(), key,
      [](const FolderEntry& a, const FolderEntry& b) { return std::tie(a.group, a.name) < std::tie(b.group, b.name); });
  return found == entries_.end() || found->name != name ? nullptr : &*found;
}

std::span<const FolderEntry> FolderFiles::group_of(const FolderEntry& entry) const {
  auto first = entries_.begin() + (&entry - entries_.data()), last = first;
  while (first != entries_.begin() && std::prev(first)->group == entry.group) --first;
  while (last != entries_.end() && last->group == entry.group) ++last;
  return {first, last};
}

}  // namespace selenograph::dem
