#include "server/http/chunked_body.h"

#include <algorithm>
#include <charconv>

#include "server/http/field_syntax.h"

namespace selenograph::server {
namespace {

void skip_blanks(std::string_view& s) { s.remove_prefix(std::min(s.find_first_not_of(" \t"), s.size())); }

std::string_view take_token(std::string_view& s) {
  std::size_t size = 0;
  while (size < s.size() && is_token(s.substr(size, 1))) ++size;
  const std::string_view token = s.substr(0, size);
  s.remove_prefix(size);
  return token;
}

// quoted-string, RFC 9110, 5.6.4; `s` starts with its quotation mark.
bool take_quoted(std::string_view& s) {
  for (std::size_t i = 1; i < s.size(); ++i) {
    if (s[i] == '\\') {
      ++i;
    } else if (s[i] == '"') {
      s.remove_prefix(i + 1);
      return true;
    }
  }
  return false;
}

// chunk-ext = *( BWS ";" BWS chunk-ext-name [ BWS "=" BWS chunk-ext-val ] )
bool are_extensions(std::string_view s) {
  while (!s.empty()) {
    skip_blanks(s);
    if (s.empty() || s.front() != ';') return false;
    s.remove_prefix(1);
    skip_blanks(s);
    if (take_token(s).empty()) return false;
    std::string_view value = s;
    skip_blanks(value);
    if (value.empty() || value.front() != '=') continue;
    value.remove_prefix(1);
    skip_blanks(value);
    if (!value.empty() && value.front() == '"' ? !take_quoted(value) : take_token(value).empty()) return false;
    s = value;
  }
  return true;
}

}  // namespace

ChunkedBody::State ChunkedBody::take(std::string_view& raw, std::string& body) {
  while (state_ == State::more && !raw.empty()) {
    if (part_ == Part::content) {
      take_content(raw, body);
    } else if (take_line(raw)) {
      end_line();
    }
  }
  return state_;
}

void ChunkedBody::take_content(std::string_view& raw, std::string& body) {
  const std::string_view part = raw.substr(0, content_left_);
  body.append(part);
  raw.remove_prefix(part.size());
  content_left_ -= part.size();
  if (content_left_ == 0) part_ = Part::content_end;
}

// Until CRLF; true when the line is whole.
bool ChunkedBody::take_line(std::string_view& raw) {
  if (!carriage_return_) {
    const std::string_view part = raw.substr(0, raw.find_first_of("\r\n"));
    const std::size_t room = part_ == Part::content_end ? 0 : kMaxLineBytes - line_.size();
    if (part.size() > room) {
      raw.remove_prefix(room);  // as if it had come byte by byte
      state_ = State::malformed;
      return false;
    }
    line_.append(part);
    raw.remove_prefix(part.size());
    if (raw.empty()) return false;
    carriage_return_ = raw.front() == '\r';
    if (!carriage_return_) state_ = State::malformed;
    raw.remove_prefix(1);
  }
  if (state_ == State::malformed || raw.empty()) return false;
  carriage_return_ = false;
  if (raw.front() != '\n') state_ = State::malformed;
  raw.remove_prefix(1);
  return state_ == State::more;
}

void ChunkedBody::end_line() {
  if (part_ == Part::size) {
    end_size_line();
  } else if (part_ == Part::content_end) {
    part_ = Part::size;
  } else if (line_.empty()) {
    state_ = State::complete;
  } else {
    trailer_bytes_ += line_.size();
    if (trailer_bytes_ > kMaxTrailerBytes || !is_field_line(line_)) state_ = State::malformed;
  }
  line_.clear();
}

void ChunkedBody::end_size_line() {
  constexpr std::size_t kMostDigits = 16;
  const std::string_view line = line_;
  const std::string_view digits = line.substr(0, line.find_first_not_of("0123456789abcdefABCDEF"));
  const std::string_view extensions = line.substr(digits.size());
  extension_bytes_ += extensions.size();
  if (digits.empty() || digits.size() > kMostDigits || extension_bytes_ > kMaxExtensionBytes ||
      has_control(extensions) || !are_extensions(extensions)) {
    state_ = State::malformed;
    return;
  }
  std::from_chars(digits.data(), digits.data() + digits.size(), content_left_, 16);
  if (content_left_ > max_body_bytes_ - body_bytes_) {
    state_ = State::too_large;
    return;
  }
  body_bytes_ += content_left_;
  part_ = content_left_ > 0 ? Part::content : Part::trailer;
}

}  // namespace selenograph::server
