// Files by what their names and labels say. A label describes the samples of an image file, beside it or behind the
// label itself. Formats of labels have a row each in labels.cpp.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "dem/files/raw_image.h"

namespace selenograph::dem {

// By the extension, in upper or lower case.
enum class FileKind { label, labelled_image, georeferenced, other };
FileKind kind_of(std::string_view path);

bool begins_with_label(const std::string& path);
// The label of a file: itself, or the one beside an image. Nothing for files that need none.
std::optional<std::string> label_of(const std::string& path);

// Whether a label is legible and about something else than a map: a scene before projection, a table.
bool describes_other_product(const std::string& path);
// The names of the files that a label points at, in lower case; none where it is illegible.
std::vector<std::string> files_named_by(const std::string& label);

// Everything needed to read the posts. Throws DataError naming the label.
RawImage describe_labelled(const std::string& label);

}  // namespace selenograph::dem
