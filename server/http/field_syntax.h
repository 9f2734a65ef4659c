// Syntax of header lines, trailer fields and chunk extensions.
#pragma once

#include <string_view>

namespace selenograph::server {

bool is_token(std::string_view s);                    // RFC 9110, 5.6.2
bool has_control(std::string_view s);                 // any control character but a tab
std::string_view without_blanks(std::string_view s);  // leading and trailing blanks removed

// "Name: value" with no blank before the colon, not folded.
bool is_field_line(std::string_view line);

}  // namespace selenograph::server
