// File kinds by name and label. A label describes the samples of an image file: a separate one, or the data after the
// label in the same file. Each label format has a row in labels.cpp.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "dem/files/raw_image.h"

namespace selenograph::dem {

// Kind of a file by its extension, ignoring case.
enum class FileKind { label, labelled_image, georeferenced, other };
FileKind kind_of(std::string_view path);

// Returns true if a file begins with a label of any format.
bool begins_with_label(const std::string& path);
// Returns the path of a file's label: the file itself, or the label next to an image. Empty for files that need none.
std::optional<std::string> label_of(const std::string& path);

// Returns true if a file is a PDS4 label, which is not read.
bool is_pds4_label(const std::string& path);
// Error text for such a file.
inline constexpr const char* kPds4Label =
    "is a PDS4 label, which is not read: make a GeoTIFF of its raster, gdal_translate -of GTiff LABEL.xml OUT.tif";

// Returns true if a label is valid but does not describe a map, but an unprojected scene or a table.
bool describes_other_product(const std::string& path);
// Returns the names of the files that a label points to, in lower case; none if it is invalid.
std::vector<std::string> files_named_by(const std::string& label);

// Returns all properties that are needed to read the posts. Throws DataError naming the label.
RawImage describe_labelled(const std::string& label);

}  // namespace selenograph::dem
