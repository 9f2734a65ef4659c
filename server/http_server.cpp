#include "server/http_server.h"

// Debian's cpp-httplib is a compiled library: classes have the layout of the macros it was built with, so ours must
// agree. `pkg-config --cflags cpp-httplib` gives them.
#if !defined(CPPHTTPLIB_OPENSSL_SUPPORT) || !defined(CPPHTTPLIB_ZLIB_SUPPORT) || !defined(CPPHTTPLIB_BROTLI_SUPPORT)
#error "compile with the flags of pkg-config --cflags cpp-httplib"
#endif
#include <httplib.h>

#include <cstring>
#include <variant>

#include "api/problem.h"
#include "server/connection.h"
#include "server/departure_watch.h"
#include "server/listener.h"
#include "server/request_head.h"

namespace selenograph::server {
namespace {

using Clock = Connection::Clock;
constexpr auto kLinger = std::chrono::milliseconds(2000);

// Chunked bodies carry sizes, extensions and trailers besides their content; httplib bounds none of them.
std::size_t raw_bound(std::size_t max_body_bytes) { return 2 * max_body_bytes + 65536; }

// A request under way on a connection.
struct Exchange {
  Connection& connection;
  const Clock::time_point receive_deadline;
  std::size_t raw_body_left;  // bytes that may still come
  std::string head{};         // what check_head() left for httplib
  std::size_t head_read = 0;  // of it
  bool parsed = false;        // httplib understood the head
  bool answered = false;      // by us; else httplib refused the request
  bool close = false;         // after the answer
  bool timed_out = false, too_long = false;
  api::Request request{};
  std::atomic<bool> abandoned{false};
  AccessRecord record{};
};

// What httplib reads from and writes to: the checked head, then the body straight from the connection.
class ExchangeStream : public httplib::Stream {
 public:
  explicit ExchangeStream(Exchange& exchange) : exchange_(exchange) {}

  bool is_readable() const override { return true; }
  bool is_writable() const override { return true; }
  socket_t socket() const override { return 0; }  // httplib only compares it with FD_SETSIZE; poll() has no such bound
  void get_remote_ip_and_port(std::string&, int&) const override {}
  void get_local_ip_and_port(std::string&, int&) const override {}

  ssize_t read(char* to, std::size_t size) override {
    if (exchange_.head_read < exchange_.head.size()) {
      size = exchange_.head.copy(to, size, exchange_.head_read);
      exchange_.head_read += size;
      return static_cast<ssize_t>(size);
    }
    if (exchange_.connection.unread().empty() && !receive()) return -1;
    exchange_.too_long = exchange_.too_long || exchange_.raw_body_left == 0;
    if (exchange_.too_long) return -1;
    size = exchange_.connection.unread().copy(to, std::min(size, exchange_.raw_body_left));
    exchange_.connection.consume(size);
    exchange_.raw_body_left -= size;
    return static_cast<ssize_t>(size);
  }

  ssize_t write(const char* bytes, std::size_t size) override {
    return exchange_.connection.write({bytes, size}) ? static_cast<ssize_t>(size) : -1;
  }

 private:
  bool receive() {
    if (!exchange_.connection.flush()) return false;  // a "100 Continue" that the client waits for
    const Connection::Read got = exchange_.connection.fill(exchange_.receive_deadline);
    exchange_.timed_out = got == Connection::Read::timed_out;
    return got == Connection::Read::data;
  }

  Exchange& exchange_;
};

// httplib's handlers are shared by all connections and get its own request only; each runs on its connection's thread.
thread_local Exchange* current_exchange = nullptr;

void hand_over(api::Response&& answer, Exchange& exchange, httplib::Response& out) {
  exchange.answered = true;
  exchange.record.error_code = answer.error_code;
  out.status = answer.status;
  for (const auto& [name, value] : answer.headers) out.set_header(name, value);
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

api::Response too_many_connections() {
  api::Response answer = api::problem("busy", "too many connections");
  answer.headers.emplace_back("Retry-After", "1");
  return answer;
}

// The library's own refusals as rows of our table.
api::Response refusal_for(int status) {
  switch (status) {
    case 404:
      return api::problem("not_found", "no such resource");
    case 413:
      return api::problem("too_large", "the body is too large");
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

  void serve(Connection& connection);
  bool serve_one(Connection& connection);
  bool receive_head(Connection& connection, std::size_t& head_bytes, Clock::time_point& deadline);
  bool process(Exchange& exchange, RequestHead&& head);
  bool refuse(Connection& connection, const HeadProblem& why);
  void set_up_library();
  void read_body(Exchange& exchange, httplib::Response& out, const httplib::ContentReader& reader);
  void answer(Exchange& exchange, httplib::Response& out);

  const HttpOptions options;
  const HttpServer::Handler handler;
  const Observer observer;
  Listener listener;
  DepartureWatch departures;
};

HttpServer::Impl::Impl(const HttpOptions& options_in, HttpServer::Handler handler_in, Observer observer_in)
    : options(options_in),
      handler(std::move(handler_in)),
      observer(std::move(observer_in)),
      listener(options.host, options.port, options.max_connections, on_the_wire(too_many_connections())) {
  set_up_library();
}

void HttpServer::Impl::set_up_library() {
  set_payload_max_length(options.max_body_bytes);
  set_keep_alive_timeout(std::chrono::ceil<std::chrono::seconds>(options.idle_timeout).count());
  // Everything without a body is answered before httplib looks for files or matches patterns.
  set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& out) {
    if (request.method == "POST") return HandlerResponse::Unhandled;
    answer(*current_exchange, out);
    return HandlerResponse::Handled;
  });
  Post(R"([\s\S]*)", [this](const httplib::Request&, httplib::Response& out, const httplib::ContentReader& reader) {
    read_body(*current_exchange, out, reader);
  });
  set_exception_handler([](const httplib::Request&, httplib::Response& out, const std::exception_ptr&) {
    current_exchange->close = true;
    hand_over(refusal_for(500), *current_exchange, out);
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

void HttpServer::Impl::read_body(Exchange& exchange, httplib::Response& out, const httplib::ContentReader& reader) {
  std::string& body = exchange.request.body;
  const bool whole = reader([&](const char* data, std::size_t size) {
    exchange.too_long = exchange.too_long || size > options.max_body_bytes - body.size();
    if (!exchange.too_long) body.append(data, size);
    return !exchange.too_long;
  });
  if (whole) return answer(exchange, out);
  exchange.close = true;
  exchange.too_long = exchange.too_long || out.status == 413;  // cpp-httplib 0.18 counts, too
  const std::string most = std::to_string(options.max_body_bytes);
  hand_over(exchange.too_long    ? api::problem("too_large", "the body is longer than " + most + " bytes")
            : exchange.timed_out ? api::problem("request_timeout", "the request did not arrive in time")
                                 : api::problem("malformed_request", "the body ends early or is not well chunked"),
            exchange, out);
}

void HttpServer::Impl::answer(Exchange& exchange, httplib::Response& out) {
  if (!exchange.connection.begin_work()) {  // given up a moment ago: nobody to answer
    exchange.close = true;
    return hand_over(api::problem("busy", "the connection was given up"), exchange, out);
  }
  exchange.request.received = Clock::now();
  exchange.request.abandoned = &exchange.abandoned;
  const DepartureWatch::Guard watch(departures, exchange.connection.fd(), &exchange.abandoned);
  exchange.close = exchange.close || listener.stopping();
  hand_over(handler(exchange.request), exchange, out);
}

void HttpServer::Impl::serve(Connection& connection) {
  try {
    while (!listener.stopping() && serve_one(connection)) connection.end_work();
  } catch (const std::exception&) {
    // Out of memory while reading: this client's connection ends, the others' go on.
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

  Exchange exchange{connection, deadline, raw_bound(options.max_body_bytes)};
  const bool delivered = process(exchange, std::get<RequestHead>(std::move(checked)));
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

bool HttpServer::Impl::process(Exchange& exchange, RequestHead&& head) {
  const auto started = Clock::now();
  exchange.record.method = exchange.request.method = head.method;
  exchange.record.target = head.target;
  exchange.head = std::move(head.text);
  exchange.close = head.close;
  exchange.request.headers = std::move(head.headers);
  current_exchange = &exchange;
  ExchangeStream stream(exchange);
  bool closed = false;
  const auto take_target = [&](httplib::Request& request) {
    exchange.parsed = true;
    exchange.record.path = exchange.request.path = request.path;
    exchange.request.query = request.params;
    request.headers.erase("Content-Type");  // forms and multipart bodies mean nothing here
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
  exchange.record.seconds = std::chrono::duration<double>(Clock::now() - started).count();
  observer(exchange.record);
  return delivered;
}

// Always false: what follows on the connection can't be trusted to be a request.
bool HttpServer::Impl::refuse(Connection& connection, const HeadProblem& why) {
  const api::Response answer = api::problem(why.error_code, why.detail);
  if (connection.write(on_the_wire(answer)) && connection.flush()) connection.linger(kLinger);
  AccessRecord refused;
  refused.status = answer.status;
  refused.bytes = answer.body.size();
  refused.error_code = answer.error_code;
  observer(refused);
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
