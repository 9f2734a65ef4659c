#include "dem/files/labels.h"

#include <algorithm>
#include <filesystem>

#include "dem/base/error.h"
#include "dem/base/names.h"
#include "dem/files/files.h"
#include "dem/files/pds_image.h"

namespace selenograph::dem {
namespace {

// Label format: extensions, recognition and parsers.
struct LabelFormat {
  std::string_view extension, image_extension;
  bool (*begins)(const std::string& path);  // returns true if a file begins like such a label
  // Parsers of a label; they throw DataError if it is illegible.
  bool (*describes_map)(const std::string& path);
  std::vector<std::string> (*files_named)(const std::string& path);
  RawImage (*describe)(const std::string& path);
};

constexpr LabelFormat kFormats[] = {
    {".lbl", ".img", begins_with_pds_label, [](const std::string& path) { return describes_map(read_pds_label(path)); },
     [](const std::string& path) { return files_named_by(read_pds_label(path)); },
     [](const std::string& path) { return describe_pds_image(read_pds_label(path), path); }},
};
constexpr std::string_view kGeoreferenced[] = {".tif", ".tiff", ".vrt"};

// Returns the extension of a path's file name, with its dot.
std::string_view extension_of(std::string_view path) {
  const std::string_view name = name_of(path);
  return name.substr(stem_of(name).size());
}

// Returns the format of a label or an image; null if it has none.
const LabelFormat* format_of(const std::string& path) {
  for (const LabelFormat& format : kFormats)
    if (same_text(extension_of(path), format.extension) || same_text(extension_of(path), format.image_extension) ||
        format.begins(path))
      return &format;
  return nullptr;
}

}  // namespace

FileKind kind_of(std::string_view path) {
  const std::string_view extension = extension_of(path);
  for (const LabelFormat& format : kFormats) {
    if (same_text(extension, format.extension)) return FileKind::label;
    if (same_text(extension, format.image_extension)) return FileKind::labelled_image;
  }
  for (const std::string_view georeferenced : kGeoreferenced)
    if (same_text(extension, georeferenced)) return FileKind::georeferenced;
  return FileKind::other;
}

bool begins_with_label(const std::string& path) {
  return std::ranges::any_of(kFormats, [&](const LabelFormat& format) { return format.begins(path); });
}

// Looks for a label with the image's name and an extension in small letters, in capitals, or with one capital.
std::optional<std::string> label_of(const std::string& path) {
  if (kind_of(path) == FileKind::label || begins_with_label(path)) return path;
  if (kind_of(path) != FileKind::labelled_image) return std::nullopt;
  std::string lower(format_of(path)->extension), upper = lower;
  for (char& c : upper) c = c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
  std::string title = lower;
  title[1] = upper[1];
  for (const std::string& extension : {lower, upper, title}) {
    const std::string label = std::filesystem::path(path).replace_extension(extension).string();
    if (file_state(label)) return label;
  }
  return std::nullopt;
}

bool is_pds4_label(const std::string& path) {
  if (!same_text(extension_of(path), ".xml")) return false;
  constexpr std::size_t kProlog = 4096;
  try {
    return read_head(path, kProlog).find("<Product_Observational") != std::string::npos;
  } catch (const DataError&) {
    return false;
  }
}

bool describes_other_product(const std::string& path) {
  const FileKind kind = kind_of(path);
  try {
    return (kind == FileKind::label || kind == FileKind::labelled_image) && !format_of(path)->describes_map(path);
  } catch (const DataError&) {
    return false;  // an illegible label may describe a map
  }
}

std::vector<std::string> files_named_by(const std::string& label) {
  try {
    return format_of(label)->files_named(label);
  } catch (const DataError&) {
    return {};  // an illegible label is reported as a problem of its own
  }
}

RawImage describe_labelled(const std::string& label) { return format_of(label)->describe(label); }

}  // namespace selenograph::dem
