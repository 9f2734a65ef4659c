// File kinds by name and label. A label describes the samples of an image file, beside it or after the label in the
// same file. Each label format has a row in labels.cpp.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "dem/files/raw_image.h"

namespace selenograph::dem {

// Kind by the extension, ignoring case.
enum class FileKind { label, labelled_image, georeferenced, other };
FileKind kind_of(std::string_view path);

bool begins_with_label(const std::string& path);
// Path of a file's label: the file itself, or the one beside an image. Empty for files that need none.
std::optional<std::string> label_of(const std::string& path);

// Tells whether a file is a PDS4 label, which is not read.
bool is_pds4_label(const std::string& path);
// Error of such a file.
inline constexpr const char* kPds4Label =
    "is a PDS4 label, which is not read: make a GeoTIFF of its raster, gdal_translate -of GTiff LABEL.xml OUT.tif";

// Whether a label is valid but does not describe a map: an unprojected scene, a table.
bool describes_other_product(const std::string& path);
// Names of the files that a label points to, in lower case; none if it is invalid.
std::vector<std::string> files_named_by(const std::string& label);

// Everything needed to read the posts. Throws DataError naming the label.
RawImage describe_labelled(const std::string& label);

}  // namespace selenograph::dem
