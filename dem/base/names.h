// Operations on file names, and on other ASCII words such as units.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace selenograph::dem {

// Converts to lower case (ASCII).
std::string lower(std::string_view text);
// Compares two texts, ignoring case.
bool same_text(std::string_view a, std::string_view b);
// Returns whether a text is not empty and has only letters, digits and the given punctuation.
bool consists_of(std::string_view text, std::string_view punctuation);
// Returns the last component of a path.
std::string_view name_of(std::string_view path);
// Returns a name without its last extension.
std::string_view stem_of(std::string_view name);

// Matches a path's last component, with or without its extension, against a shell pattern.
bool name_matches(const std::string& path, const std::string& pattern);

// The supported units of heights, for messages.
inline constexpr std::string_view kLengthUnits = "m, km, cm, mm, ft, US survey foot";
// Returns the metres in a unit, by any of its names, ignoring case; empty if it is not supported.
std::optional<double> metres_in(std::string_view unit);

}  // namespace selenograph::dem
