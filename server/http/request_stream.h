// One request as the HTTP library may read it: strictly framed, bounded in size, complete by one deadline.
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
  std::chrono::milliseconds receive_timeout;  // first byte to last, however it dribbles
};

// Bytes behind the end of the request stay in the connection: they are the next request's.
class RequestStream {
 public:
  RequestStream(Connection& connection, const RequestBounds& bounds) : connection_(connection), bounds_(bounds) {}

  // Waits for a request and reads its head. False: no request comes, and there is nobody to answer. A head that is
  // refused is a problem().
  bool open();

  // As far as it is known. What is refused before it is read, here or by refuse(), reads as a request without headers
  // and body, so that the library has one to answer.
  const RequestHead& head() const { return head_; }
  const std::optional<HeadProblem>& problem() const { return problem_; }
  void refuse(HeadProblem why);

  // The next bytes: the head as check_head() wrote it, then the body. Chunks have other sizes than those that came, and
  // neither extensions nor trailers. -1: there are no more, or there is a problem().
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
  bool begun_ = false;          // to be read
  std::string text_;            // a part of what read() gives
  std::size_t read_bytes_ = 0;  // of text_
  std::size_t body_bytes_left_ = 0;
  ChunkedBody chunks_{bounds_.max_body_bytes};
};

}  // namespace selenograph::server
