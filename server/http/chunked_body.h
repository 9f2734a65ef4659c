// Decodes a request body sent in chunks (RFC 9112, 7.1), strictly: what two recipients could read in two ways is no
// body at all.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace selenograph::server {

// Incremental, and bounded whatever comes: a line of framing that is not complete yet is all that it keeps.
//  - A size is 1 to 16 hexadecimal digits, nothing before and only extensions behind it. Lines end with CRLF.
//  - Extensions (`;name`, `;name=value`) and trailer fields are checked, then dropped.
class ChunkedBody {
 public:
  static constexpr std::size_t kMaxLineBytes = 1024;        // size and extensions of a chunk, or one trailer field
  static constexpr std::size_t kMaxExtensionBytes = 16384;  // of all chunks
  static constexpr std::size_t kMaxTrailerBytes = 8192;     // of all fields

  explicit ChunkedBody(std::size_t max_body_bytes) : max_body_bytes_(max_body_bytes) {}

  enum class State {
    more,       // is not at its end
    complete,   // what follows belongs to the next request
    malformed,  // not chunked as it should be, or with more extensions or trailers than are taken
    too_large,  // content of more than max_body_bytes
  };

  // Takes from the front of `raw` what belongs to this body, and appends the content to `body`, which holds that of
  // earlier calls. Once the state is not `more`, nothing is taken.
  State take(std::string_view& raw, std::string& body);
  State state() const { return state_; }

 private:
  enum class Part { size, content, content_end, trailer };
  bool take_line(std::string_view& raw);
  void end_line();
  void end_size_line();
  void take_content(std::string_view& raw, std::string& body);

  const std::size_t max_body_bytes_;
  State state_ = State::more;
  Part part_ = Part::size;
  std::string line_;              // of framing, without CRLF
  bool carriage_return_ = false;  // has come, its line feed has not
  std::size_t content_left_ = 0;  // of this chunk
  std::size_t body_bytes_ = 0, extension_bytes_ = 0, trailer_bytes_ = 0;
};

}  // namespace selenograph::server
