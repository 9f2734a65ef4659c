// The byte stream of one request for the HTTP library: strictly framed, bounded in size, complete by one deadline.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "server/http/chunked_body.h"
#include "server/http/connection.h"
#include "server/http/request_head.h"

namespace selenograph::server {

struct RequestBounds {
  std::size_t max_body_bytes;
  std::chrono::milliseconds idle_timeout;     // until its first byte
  std::chrono::milliseconds receive_timeout;  // from first to last byte
};

// Bytes after the end of the request stay in the connection: they belong to the next request.
class RequestStream {
 public:
  RequestStream(Connection& connection, const RequestBounds& bounds) : connection_(connection), bounds_(bounds) {}

  // Waits for a request and reads its head. False: no request, and nobody to respond to. A refused head is a problem().
  bool open();

  // The head as far as it is known. A request refused before it is read, here or by refuse(), reads as one without
  // headers and body, so that the library has one to answer.
  const RequestHead& head() const { return head_; }
  const std::optional<HeadProblem>& problem() const { return problem_; }
  void refuse(HeadProblem why);

  // Reads the next bytes: the head as rewritten by check_head(), then the body. Chunk sizes differ from the received
  // ones; extensions and trailers are removed. -1: no more bytes, or a problem().
  ssize_t read(char* to, std::size_t size);

 private:
  bool receive_head(std::size_t& head_bytes);
  bool more_of_the_body();
  void take(std::string_view& raw);
  bool fill();

  Connection& connection_;
  const RequestBounds bounds_;
  Connection::Clock::time_point deadline_{};
  RequestHead head_;
  std::optional<HeadProblem> problem_;
  bool begun_ = false;          // reading has begun
  std::string text_;            // current part of the output of read()
  std::size_t read_bytes_ = 0;  // of text_
  std::size_t body_bytes_left_ = 0;
  ChunkedBody chunks_{bounds_.max_body_bytes};
};

}  // namespace selenograph::server
