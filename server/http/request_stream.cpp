#include "server/http/request_stream.h"

#include <fmt/format.h>

#include <utility>
#include <variant>

namespace selenograph::server {

using Clock = Connection::Clock;

bool RequestStream::open() {
  if (connection_.unread().empty() && connection_.fill(Clock::now() + bounds_.idle_timeout) != Connection::Read::data)
    return false;
  deadline_ = Clock::now() + bounds_.receive_timeout;
  std::size_t head_bytes = 0;
  if (!receive_head(head_bytes)) return problem_.has_value();
  auto checked = check_head(connection_.unread().substr(0, head_bytes), bounds_.max_body_bytes);
  connection_.consume(head_bytes);
  if (auto* problem = std::get_if<HeadProblem>(&checked)) {
    refuse(std::move(*problem));
    return true;
  }
  head_ = std::get<RequestHead>(std::move(checked));
  body_bytes_left_ = head_.body_bytes;
  return true;
}

// What follows on the connection can't be trusted to be a request.
void RequestStream::refuse(HeadProblem why) {
  problem_ = std::move(why);
  head_.close = true;
}

// Until the empty line after the headers.
bool RequestStream::receive_head(std::size_t& head_bytes) {
  for (;;) {
    while (connection_.unread().substr(0, 2) == "\r\n") connection_.consume(2);  // RFC 9112 2.2
    const std::size_t end = connection_.unread().substr(0, kMaxHeadBytes).find("\r\n\r\n");
    if (end != std::string_view::npos) {
      head_bytes = end + 4;
      return true;
    }
    if (connection_.unread().size() >= kMaxHeadBytes) {
      refuse({"headers_too_large", fmt::format("the head has more than {} bytes", kMaxHeadBytes)});
      return false;
    }
    if (!fill()) return false;
  }
}

// A client that closes while it sends its head has left; one that closes while it sends its body may wait for an
// answer.
bool RequestStream::fill() {
  const Connection::Read got = connection_.fill(deadline_);
  if (got == Connection::Read::timed_out) refuse({"request_timeout", "the request did not arrive in time"});
  return got == Connection::Read::data;
}

ssize_t RequestStream::read(char* to, std::size_t size) {
  if (!begun_) {
    begun_ = true;
    text_ = !problem_ ? head_.text : head_.method == "HEAD" ? "HEAD / HTTP/1.1\r\n\r\n" : "GET / HTTP/1.1\r\n\r\n";
  } else if (read_bytes_ == text_.size() && !more_of_the_body()) {
    return -1;
  }
  const std::size_t part = text_.copy(to, size, read_bytes_);
  read_bytes_ += part;
  return static_cast<ssize_t>(part);
}

bool RequestStream::more_of_the_body() {
  text_.clear();
  read_bytes_ = 0;
  while (text_.empty()) {
    const bool at_end = head_.chunked ? chunks_.state() == ChunkedBody::State::complete : body_bytes_left_ == 0;
    if (problem_ || at_end) return false;
    // Before the client is waited for, it gets what the library has written: "100 Continue".
    if (connection_.unread().empty() && !(connection_.flush() && fill())) {
      if (!problem_) refuse({"malformed_request", "the body ends early"});
      return false;
    }
    std::string_view raw = connection_.unread();
    const std::size_t came = raw.size();
    take(raw);
    connection_.consume(came - raw.size());
  }
  return !problem_;
}

void RequestStream::take(std::string_view& raw) {
  if (!head_.chunked) {
    text_ = raw.substr(0, body_bytes_left_);
    raw.remove_prefix(text_.size());
    body_bytes_left_ -= text_.size();
    return;
  }
  const ChunkedBody::State state = chunks_.take(raw, text_);
  if (!text_.empty()) text_ = fmt::format("{:x}\r\n{}\r\n", text_.size(), text_);
  if (state == ChunkedBody::State::complete) text_ += "0\r\n\r\n";
  if (state == ChunkedBody::State::malformed)
    refuse({"malformed_request", "invalid chunked encoding of the body (RFC 9112, 7.1)"});
  if (state == ChunkedBody::State::too_large)
    refuse({"too_large", fmt::format("the body is longer than {} bytes", bounds_.max_body_bytes)});
}

}  // namespace selenograph::server
