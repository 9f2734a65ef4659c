// Decodes a chunked request body (RFC 9112, 7.1) strictly: anything that two recipients could interpret differently is
// rejected.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace selenograph::server {

// Incremental, with bounded memory: it stores at most one incomplete framing line.
//  - A size is 1 to 16 hexadecimal digits, preceded by nothing and followed only by extensions. Lines end with CRLF.
//  - Extensions (`;name`, `;name=value`) and trailer fields are checked, then dropped.
class ChunkedBody {
 public:
  static constexpr std::size_t kMaxLineBytes = 1024;        // size and extensions of a chunk, or one trailer field
  static constexpr std::size_t kMaxExtensionBytes = 16384;  // of all chunks
  static constexpr std::size_t kMaxTrailerBytes = 8192;     // of all fields

  explicit ChunkedBody(std::size_t max_body_bytes) : max_body_bytes_(max_body_bytes) {}

  enum class State {
    more,       // incomplete
    complete,   // complete; further bytes belong to the next request
    malformed,  // invalid framing, or too many extensions or trailers
    too_large,  // content of more than max_body_bytes
  };

  // Consumes from the front of `raw` what belongs to this body, and appends the content to `body`, which holds that of
  // earlier calls. Once the state is not `more`, nothing is consumed.
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
  bool carriage_return_ = false;  // received, without its line feed
  std::size_t content_left_ = 0;  // of this chunk
  std::size_t body_bytes_ = 0, extension_bytes_ = 0, trailer_bytes_ = 0;
};

}  // namespace selenograph::server
