// Operations on file names, and on other words of ASCII such as those of units.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace selenograph::dem {

// Converts to lower case (ASCII).
std::string lower(std::string_view text);
// Equality ignoring case.
bool same_text(std::string_view a, std::string_view b);
// Whether a text is not empty and has only letters, digits and characters of `others`.
bool consists_of(std::string_view text, std::string_view others);
// Last component of a path.
std::string_view name_of(std::string_view path);
// Name without its last extension.
std::string_view stem_of(std::string_view name);

// Matches a path's last component, with or without its extension, against a pattern as in a shell.
bool name_matches(const std::string& path, const std::string& pattern);

// Units of length in which heights are read, for messages.
inline constexpr std::string_view kLengthUnits = "m, km, cm, mm, ft, US survey foot";
// Metres in one of them by any of its names, in any case; empty: it is none of them.
std::optional<double> metres_in(std::string_view unit);

}  // namespace selenograph::dem
