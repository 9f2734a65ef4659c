// Operations on file names, and on other words of ASCII.
#pragma once

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

}  // namespace selenograph::dem
