// Names of files as texts.
#pragma once

#include <string>
#include <string_view>

namespace selenograph::dem {

// In lower case (ASCII).
std::string lower(std::string_view text);
// Whether they are, but for the case.
bool same_text(std::string_view a, std::string_view b);
// The last component.
std::string_view name_of(std::string_view path);
// Without its last extension.
std::string_view stem_of(std::string_view name);

}  // namespace selenograph::dem
