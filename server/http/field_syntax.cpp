#include "server/http/field_syntax.h"

#include <algorithm>

#include "dem/files/names.h"

namespace selenograph::server {

bool is_token(std::string_view s) { return dem::consists_of(s, "!#$%&'*+-.^_`|~"); }

bool has_control(std::string_view s) {
  return std::any_of(s.begin(), s.end(), [](unsigned char c) { return (c < 32 && c != '\t') || c == 127; });
}

std::string_view without_blanks(std::string_view s) {
  while (!s.empty() && (s.front() == ' ' || s.front() == '\t')) s.remove_prefix(1);
  while (!s.empty() && (s.back() == ' ' || s.back() == '\t')) s.remove_suffix(1);
  return s;
}

bool is_field_line(std::string_view line) {
  const std::size_t colon = line.find(':');
  return colon != std::string_view::npos && is_token(line.substr(0, colon)) && !has_control(line.substr(colon + 1));
}

}  // namespace selenograph::server
