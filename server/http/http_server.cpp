#include "server/http/http_server.h"

// Debian's cpp-httplib is a compiled library: classes have the layout of the macros it was built with, so ours must
// agree. `pkg-config --cflags cpp-httplib` gives them.
#if !defined(CPPHTTPLIB_OPENSSL_SUPPORT) || !defined(CPPHTTPLIB_ZLIB_SUPPORT) || !defined(CPPHTTPLIB_BROTLI_SUPPORT)
#error "compile with the flags of pkg-config --cflags cpp-httplib"
#endif
#include <httplib.h>

#include <algorithm>
#include <charconv>
#include <cstring>
#include <new>
#include <optional>
#include <variant>

#include "api/message/problem.h"
#include "server/http/allowed_hosts.h"
#include "server/http/caller.h"
#include "server/http/chunked_body.h"
#include "server/http/connection.h"
#include "server/http/departure_watch.h"
#include "server/http/listener.h"
#include "server/http/request_head.h"

namespace selenograph::server {
namespace {

using Clock = Connection::Clock;
constexpr auto kLinger = std::chrono::milliseconds(2000);
constexpr int kSpareRetryAfter_s = 5;

// A request under way on a connection.
struct Exchange {
  Connection& connection;
  const Clock::time_point receive_deadline;
  RequestHead head;
  std::size_t head_read = 0;  // of its text, by httplib
  bool parsed = false;        // httplib understood the head
  bool answered = false;      // by us; else httplib refused the request
  bool close = false;         // after the answer
  api::Request request{};
  api::MemoryBudget::Claim body_memory{};                           // of the request's body
  std::shared_ptr<const api::MemoryBudget::Claim> answer_memory{};  // until it is sent
  std::atomic<bool> abandoned{false};
  AccessRecord record{};
};

// What httplib reads from and writes to: the checked head, then nothing.
class ExchangeStream : public httplib::Stream {
 public:
  explicit ExchangeStream(Exchange& exchange) : exchange_(exchange) {}

  bool is_readable() const override { return true; }
  bool is_writable() const override { return true; }
  socket_t socket() const override { return 0; }  // httplib only compares it with FD_SETSIZE; poll() has no such bound
  void get_remote_ip_and_port(std::string&, int&) const override {}
  void get_local_ip_and_port(std::string&, int&) const override {}

  ssize_t read(char* to, std::size_t size) override {
    if (exchange_.head_read >= exchange_.head.text.size()) return -1;
    size = exchange_.head.text.copy(to, size, exchange_.head_read);
    exchange_.head_read += size;
    return static_cast<ssize_t>(size);
  }

  ssize_t write(const char* bytes, std::size_t size) override {
    return exchange_.connection.write({bytes, size}) ? static_cast<ssize_t>(size) : -1;
  }

 private:
  Exchange& exchange_;
};

constexpr char kRequestId[] = "X-Request-Id";

double seconds(Clock::duration time) { return std::chrono::duration<double>(time).count(); }

// "parse;dur=0.1, load;dur=2": our own, by the answer's header.
std::vector<std::pair<std::string, double>> stages_of(const api::Response& answer) {
  std::vector<std::pair<std::string, double>> stages;
  for (const auto& [name, value] : answer.headers) {
    if (name != "Server-Timing") continue;
    for (std::string_view rest = value; !rest.empty();) {
      const std::string_view entry = rest.substr(0, rest.find(','));
      rest.remove_prefix(std::min(entry.size() + 1, rest.size()));
      const std::size_t start = entry.find_first_not_of(' '), end = entry.find(";dur=");
      double ms = 0;
      if (end == std::string_view::npos || start >= end) continue;
      std::from_chars(entry.data() + end + 5, entry.data() + entry.size(), ms);
      stages.emplace_back(entry.substr(start, end - start), ms);
    }
  }
  return stages;
}

const HeadProblem kEndsEarly{"malformed_request", "the body ends early"};

// httplib's handlers are shared by all connections and get its own request only; each runs on its connection's thread.
thread_local Exchange* current_exchange = nullptr;

void hand_over(api::Response&& answer, Exchange& exchange, httplib::Response& out) {
  exchange.answered = true;
  exchange.record.error_code = answer.error_code;
  exchange.answer_memory = std::move(answer.memory);
  out.status = answer.status;
  for (const auto& [name, value] : answer.headers) out.set_header(name, value);
  out.set_header(kRequestId, exchange.record.request_id);
  if (!answer.content_type.empty()) out.set_header("Content-Type", answer.content_type);
  out.set_header("Accept-Ranges", "none");
  out.body = std::move(answer.body);  // moved: a frame has tens of megabytes
}

// The answer to a head that httplib never sees.
std::string on_the_wire(const api::Response& answer) {
  const std::string reason(api::error_row(answer.error_code).title);
  std::string text = "HTTP/1.1 " + std::to_string(answer.status) + ' ' + reason +
                     "\r\nContent-Type: " + answer.content_type +
                     "\r\nContent-Length: " + std::to_string(answer.body.size()) + "\r\nConnection: close\r\n";
  for (const auto& [name, value] : answer.headers) text += name + ": " + value + "\r\n";
  return text + "\r\n" + answer.body;
}

api::Response refusal(const std::string& code, const std::string& detail, int retry_after_s) {
  api::Response answer = api::problem(code, detail);
  answer.headers.emplace_back("Retry-After", std::to_string(retry_after_s));
  return answer;
}

// The library's own refusals as rows of our table.
api::Response refusal_for(int status) {
  switch (status) {
    case 404:
      return api::problem("not_found", "no such resource");
    case 414:
      return api::problem("uri_too_long", "the request target is too long");
    case 500:
      return api::problem("internal", "the request could not be handled");
    default:
      return api::problem("malformed_request", "not a well-formed HTTP/1.1 request");
  }
}

}  // namespace

// httplib's server without its sockets, queue and threads.
struct HttpServer::Impl : private httplib::Server {
  Impl(const HttpOptions& options_in, HttpServer::Handler handler_in, Observer observer_in);

  ListenerOptions listener_options() const;
  void set_up_library();
  void serve(Connection& connection) noexcept;
  bool serve_one(Connection& connection);
  bool receive_head(Connection& connection, std::size_t& head_bytes, Clock::time_point& deadline);
  std::optional<HeadProblem> receive_body(Exchange& exchange);
  bool process(Exchange& exchange);
  void answer(Exchange& exchange, httplib::Response& out);
  bool refuse(Connection& connection, const HeadProblem& why, AccessRecord refused = {});
  void answer_without_memory(Connection& connection) noexcept;
  void observe(const AccessRecord& record) noexcept;

  const HttpOptions options;
  const AllowedHosts hosts;
  const HttpServer::Handler handler;
  const Observer observer;
  const std::string spare_answer;  // when there is no memory to make one
  Listener listener;
  DepartureWatch departures;
};

HttpServer::Impl::Impl(const HttpOptions& options_in, HttpServer::Handler handler_in, Observer observer_in)
    : options(options_in),
      hosts(options.host, options.allowed_hosts),
      handler(std::move(handler_in)),
      observer(std::move(observer_in)),
      spare_answer(on_the_wire(
          refusal(std::string(api::kOutOfMemory), "not enough memory for this request", kSpareRetryAfter_s))),
      listener(listener_options()) {
  set_up_library();
}

ListenerOptions HttpServer::Impl::listener_options() const {
  const auto busy = [this] {
    api::Response answer = refusal("busy", "too many connections", options.retry_after_s());
    answer.headers.emplace_back(kRequestId, new_request_id());
    return on_the_wire(answer);
  };
  return {options.host, options.port, options.max_connections, options.send_pace, busy, spare_answer};
}

void HttpServer::Impl::set_up_library() {
  set_keep_alive_timeout(std::chrono::ceil<std::chrono::seconds>(options.idle_timeout).count());
  // Everything is answered before httplib looks for bodies and files or matches patterns.
  set_pre_routing_handler([this](const httplib::Request&, httplib::Response& out) {
    answer(*current_exchange, out);
    return HandlerResponse::Handled;
  });
  // Nothing here throws but for lack of memory, and then httplib's own answer would not fit, either: serve() has one.
  set_exception_handler([](const httplib::Request&, httplib::Response&, const std::exception_ptr& error) {
    std::rethrow_exception(error);
  });
  set_error_handler([](const httplib::Request&, httplib::Response& out) {
    if (current_exchange->answered) return;
    current_exchange->close = true;
    hand_over(refusal_for(out.status), *current_exchange, out);
  });
  set_post_routing_handler([](const httplib::Request&, httplib::Response& out) {
    if (out.status == 304) out.headers.erase("Content-Length");  // httplib says 0; it would mean the representation's
    out.headers.erase("Keep-Alive");                             // promises a bound on requests that there isn't
    out.headers.erase("Connection");
    if (current_exchange->close) out.set_header("Connection", "close");
  });
  set_logger([](const httplib::Request&, const httplib::Response& out) {
    current_exchange->record.status = out.status;
    current_exchange->record.bytes = out.body.size();
  });
}

void HttpServer::Impl::answer(Exchange& exchange, httplib::Response& out) {
  if (!exchange.connection.begin_work()) {  // given up a moment ago: nobody to answer
    exchange.close = true;
    return hand_over(api::problem("busy", "the connection was given up"), exchange, out);
  }
  exchange.request.received = Clock::now();
  exchange.request.abandoned = &exchange.abandoned;
  api::Response response;
  Peer peer = exchange.connection.peer();
  if (!exchange.record.token.empty()) {
    peer.address = "token " + exchange.record.token;
    peer.number = 0;  // a proxy's connections carry anybody's requests
  }
  Clock::duration queued{};
  {
    const DepartureWatch::Guard watch(departures, exchange.connection.fd(), !exchange.head.http_1_0,
                                      &exchange.abandoned);
    response = handler(exchange.request, peer, queued);
  }
  exchange.record.queued_s = seconds(queued);
  exchange.record.work_s = seconds(Clock::now() - exchange.request.received - queued);
  exchange.record.stages_ms = stages_of(response);
  exchange.request.body = {};  // a slow reader keeps its answer, and nothing else
  exchange.body_memory = {};
  exchange.connection.begin_answer();
  // A reserved connection stays one: who was refused on it comes back on another, and leaves it to the next.
  exchange.close = exchange.close || listener.stopping() || exchange.connection.peer().reserved;
  if (response.error_code == api::kOutOfMemory && response.body.empty()) throw std::bad_alloc();
  hand_over(std::move(response), exchange, out);
}

void HttpServer::Impl::serve(Connection& connection) noexcept {
  try {
    while (!listener.stopping() && serve_one(connection)) connection.end_work();
  } catch (...) {
    answer_without_memory(connection);
  }
}

// One that has got a part of its answer gets no other.
void HttpServer::Impl::answer_without_memory(Connection& connection) noexcept {
  if (connection.answer_begun() || !connection.write_without_memory(spare_answer)) return;
  connection.end_work();
  try {
    AccessRecord record;
    record.status = api::error_row(api::kOutOfMemory).status;
    record.error_code = api::kOutOfMemory;
    observe(record);
    connection.linger(kLinger);
  } catch (...) {
  }
}

void HttpServer::Impl::observe(const AccessRecord& record) noexcept {
  try {
    observer(record);
  } catch (...) {  // no memory to count with
  }
}

// One request of a connection, first byte to last. False: the connection is over.
bool HttpServer::Impl::serve_one(Connection& connection) {
  std::size_t head_bytes = 0;
  Clock::time_point deadline;
  if (!receive_head(connection, head_bytes, deadline)) return false;
  auto checked = check_head(connection.unread().substr(0, head_bytes), options.max_body_bytes);
  connection.consume(head_bytes);
  if (const auto* problem = std::get_if<HeadProblem>(&checked)) return refuse(connection, *problem);

  Exchange exchange{connection, deadline, std::get<RequestHead>(std::move(checked))};
  exchange.record.method = exchange.request.method = exchange.head.method;
  exchange.record.target = exchange.head.target;
  exchange.record.path = exchange.head.target.substr(0, exchange.head.target.find('?'));  // until it is decoded
  exchange.record.request_id = request_id_of(exchange.head.headers);
  exchange.record.host = connection.peer().host;
  if (is_trusted_proxy(connection.peer().host, options.trusted_proxies))
    exchange.record.token = token_of(exchange.head.headers);
  exchange.close = exchange.head.close;
  if (const auto problem = hosts.refusal(exchange.head, connection.peer().local))
    return refuse(connection, *problem, exchange.record);
  if (const auto problem = receive_body(exchange)) return refuse(connection, *problem, exchange.record);
  exchange.record.request_bytes = exchange.request.body.size();
  const bool delivered = process(exchange);
  if (delivered && !exchange.close) return true;
  connection.end_work();
  if (delivered) connection.linger(kLinger);
  return false;
}

// Until the empty line after the headers. Answers false when the connection ends here.
bool HttpServer::Impl::receive_head(Connection& connection, std::size_t& head_bytes, Clock::time_point& deadline) {
  if (connection.unread().empty() && connection.fill(Clock::now() + options.idle_timeout) != Connection::Read::data)
    return false;
  deadline = Clock::now() + options.receive_timeout;
  for (;;) {
    while (connection.unread().substr(0, 2) == "\r\n") connection.consume(2);  // RFC 9112 2.2
    const std::size_t end = connection.unread().substr(0, kMaxHeadBytes).find("\r\n\r\n");
    if (end != std::string_view::npos) {
      head_bytes = end + 4;
      return true;
    }
    if (connection.unread().size() >= kMaxHeadBytes) {
      return refuse(connection,
                    {"headers_too_large", "the head has more than " + std::to_string(kMaxHeadBytes) + " bytes"});
    }
    const Connection::Read got = connection.fill(deadline);
    if (got == Connection::Read::timed_out)
      return refuse(connection, {"request_timeout", "the request did not arrive in time"});
    if (got == Connection::Read::closed) return false;
  }
}

// The only place where a body grows. Bytes behind its end stay unread: they are the next request's.
std::optional<HeadProblem> HttpServer::Impl::receive_body(Exchange& exchange) {
  Connection& connection = exchange.connection;
  std::string& body = exchange.request.body;
  const HeadProblem no_room{"busy", "the memory for requests that are arriving is in use by others"};
  if (auto claim = options.bodies->try_claim(0))
    exchange.body_memory = std::move(*claim);
  else
    return no_room;
  const auto fits = [&] {
    return body.capacity() <= exchange.body_memory.bytes() || exchange.body_memory.try_resize(body.capacity());
  };
  ChunkedBody chunks(options.max_body_bytes);
  const auto take = [&] {  // true: the body is whole, or will never be
    std::string_view raw = connection.unread();
    const std::size_t came = raw.size();
    if (exchange.head.chunked) {
      chunks.take(raw, body);
    } else {
      const std::string_view part = raw.substr(0, exchange.head.body_bytes - body.size());
      body.append(part);
      raw.remove_prefix(part.size());
    }
    connection.consume(came - raw.size());
    return exchange.head.chunked ? chunks.state() != ChunkedBody::State::more : body.size() == exchange.head.body_bytes;
  };
  bool continued = !exchange.head.expects_continue || !connection.unread().empty();
  while (!take()) {
    if (!fits()) return no_room;
    if (!continued) {
      continued = true;
      if (!connection.write("HTTP/1.1 100 Continue\r\n\r\n") || !connection.flush()) return kEndsEarly;
    }
    const Connection::Read got = connection.fill(exchange.receive_deadline);
    if (got == Connection::Read::timed_out) return HeadProblem{"request_timeout", "the request did not arrive in time"};
    if (got == Connection::Read::closed) return kEndsEarly;
  }
  if (!exchange.head.chunked || chunks.state() == ChunkedBody::State::complete) return {};
  if (chunks.state() == ChunkedBody::State::malformed)
    return HeadProblem{"malformed_request", "the body is not well chunked (RFC 9112, 7.1)"};
  return HeadProblem{"too_large", "the body is longer than " + std::to_string(options.max_body_bytes) + " bytes"};
}

// An answer is held from hand_over() until it is sent, which is when httplib's process_request() returns.
bool HttpServer::Impl::process(Exchange& exchange) {
  const auto started = Clock::now();
  exchange.request.headers = std::move(exchange.head.headers);
  current_exchange = &exchange;
  ExchangeStream stream(exchange);
  bool closed = false;
  const auto take_target = [&](httplib::Request& request) {
    exchange.parsed = true;
    exchange.record.path = exchange.request.path = request.path;
    exchange.request.query = request.params;
  };
  // cpp-httplib 0.18 also takes the addresses of both ends, only to pass them on.
  const auto process_in = [&](auto& library) {
    if constexpr (requires { library.process_request(stream, exchange.close, closed, take_target); })
      return library.process_request(stream, exchange.close, closed, take_target);
    else
      return library.process_request(stream, "", 0, "", 0, exchange.close, closed, take_target);
  };
  const bool written = process_in(*this);
  current_exchange = nullptr;
  exchange.close = exchange.close || closed || !exchange.parsed;
  const bool delivered = written && exchange.connection.flush();
  exchange.record.seconds = seconds(Clock::now() - started);
  observe(exchange.record);
  return delivered;
}

// Always false: what follows on the connection can't be trusted to be a request.
bool HttpServer::Impl::refuse(Connection& connection, const HeadProblem& why, AccessRecord refused) {
  api::Response answer = api::problem(why.error_code, why.detail);
  if (why.error_code == "busy") answer.headers.emplace_back("Retry-After", std::to_string(options.retry_after_s()));
  if (refused.request_id.empty()) refused.request_id = new_request_id();
  refused.host = connection.peer().host;
  answer.headers.emplace_back(kRequestId, refused.request_id);
  std::string text = on_the_wire(answer);
  if (refused.method == "HEAD") {  // the head of what GET would be answered
    text.resize(text.size() - answer.body.size());
    answer.body.clear();
  }
  if (connection.write(text) && connection.flush()) connection.linger(kLinger);
  refused.status = answer.status;
  refused.bytes = answer.body.size();
  refused.error_code = answer.error_code;
  observe(refused);
  return false;
}

HttpServer::HttpServer(const HttpOptions& options, Handler handler, Observer observer)
    : impl_(std::make_unique<Impl>(options, std::move(handler), std::move(observer))) {}
HttpServer::~HttpServer() = default;

int HttpServer::port() const { return impl_->listener.port(); }
int HttpServer::connections() const { return impl_->listener.connections(); }
std::string HttpServer::url() const {
  const std::string& host = impl_->options.host;
  const bool v6 = host.find(':') != std::string::npos;
  return "http://" + (v6 ? '[' + host + ']' : host) + ':' + std::to_string(port());
}
void HttpServer::run() {
  impl_->listener.run([this](Connection& connection) { impl_->serve(connection); });
}
void HttpServer::stop() { impl_->listener.stop(); }
bool HttpServer::wait_until_done(Clock::time_point deadline) { return impl_->listener.wait_until_done(deadline); }
void HttpServer::cut() { impl_->listener.cut(); }

ClientAnswer http_request(const std::string& url, const std::string& method, const std::string& path,
                          const std::string& body, const std::string& accept) {
  httplib::Client client(url);
  client.set_read_timeout(std::chrono::minutes(2));
  const httplib::Headers headers{{"Accept", accept}};
  const httplib::Result result =
      method == "POST" ? client.Post(path, headers, body, "application/json") : client.Get(path, headers);
  if (!result) return {};
  return {result->status, result->get_header_value("Content-Type"), result->body};
}

}  // namespace selenograph::server
