#include "dem/files.h"

#include <sys/stat.h>

#include <algorithm>
#include <cctype>

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;

struct KnownExtension {
  const char* extension;
  FileKind kind;
};
constexpr KnownExtension kKnownExtensions[] = {{".lbl", FileKind::pds_label},
                                               {".img", FileKind::pds_image},
                                               {".tif", FileKind::georeferenced},
                                               {".tiff", FileKind::georeferenced},
                                               {".vrt", FileKind::georeferenced}};

}  // namespace

FileKind kind_of(const fs::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  for (const KnownExtension& known : kKnownExtensions)
    if (extension == known.extension) return known.kind;
  return FileKind::other;
}

std::optional<std::string> label_beside(const fs::path& image) {
  for (const char* extension : {".lbl", ".LBL", ".Lbl"}) {
    const std::string label = fs::path(image).replace_extension(extension).string();
    if (file_state(label)) return label;
  }
  return std::nullopt;
}

std::optional<FileState> file_state(const std::string& path) {
  struct stat s {};
  if (::stat(path.c_str(), &s) != 0 || !S_ISREG(s.st_mode)) return std::nullopt;
  return FileState{static_cast<std::uint64_t>(s.st_size),
                   static_cast<std::int64_t>(s.st_mtim.tv_sec) * 1'000'000'000 + s.st_mtim.tv_nsec};
}

}  // namespace selenograph::dem
