#include "server/http/http_server.h"

// Debian's cpp-httplib is a compiled library: classes have the layout of the macros it was built with, so ours must
// agree. `pkg-config --cflags cpp-httplib` gives them.
#if !defined(CPPHTTPLIB_OPENSSL_SUPPORT) || !defined(CPPHTTPLIB_ZLIB_SUPPORT) || !defined(CPPHTTPLIB_BROTLI_SUPPORT)
#error "compile with the flags of pkg-config --cflags cpp-httplib"
#endif
#include <httplib.h>

#include <algorithm>
#include <new>

#include "api/message/problem.h"
#include "api/message/timing.h"
#include "server/http/allowed_hosts.h"
#include "server/http/caller.h"
#include "server/http/connection.h"
#include "server/http/departure_watch.h"
#include "server/http/listener.h"
#include "server/http/request_stream.h"

namespace selenograph::server {
namespace {

using Clock = Connection::Clock;
constexpr auto kLinger = std::chrono::milliseconds(2000);
constexpr int kSpareRetryAfter_s = 5;
constexpr std::size_t kFreeBody_bytes = 65536;  // needs no claim: as much as a connection may hold anyway
constexpr char kRequestId[] = "X-Request-Id";

double seconds(Clock::duration time) { return std::chrono::duration<double>(time).count(); }

// Completes the answer's Server-Timing, if it has one. Returns its durations, as the client gets them.
api::Durations complete_timing(api::Response& answer, double total_ms) {
  for (auto& [name, value] : answer.headers) {
    if (name != "Server-Timing") continue;
    api::Durations durations = api::read_timing(value);
    api::complete_timing(durations, total_ms);
    value = api::timing_text(durations);
    return api::read_timing(value);
  }
  return {};
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

// One request for the library: its server without sockets, queue and threads, and the stream that it reads the request
// from and writes the answer to. A server for each request, because the library's handlers are given nothing else that
// says whose request they answer.
class Exchange : private httplib::Server, protected httplib::Stream {
 protected:
  Exchange();
  using ReadBody = std::function<bool(const httplib::ContentReceiver&)>;
  // Has the library read, route and answer the request. False: the answer could not be written.
  bool process();
  void take_posts();

  // What is answered; `request` has no body but what read_body() reads.
  virtual api::Response respond(const httplib::Request& request, const ReadBody& read_body) = 0;

  bool close_ = false;  // after the answer
  AccessRecord record_;

 private:
  void hand_over(api::Response&& answer, httplib::Response& out);
  bool is_readable() const override { return true; }
  bool is_writable() const override { return true; }
  socket_t socket() const override { return 0; }  // httplib only compares it with FD_SETSIZE; poll() has no such bound
  void get_remote_ip_and_port(std::string&, int&) const override {}
  void get_local_ip_and_port(std::string&, int&) const override {}

  bool answered_ = false;                                          // by us; else httplib refused the request
  std::shared_ptr<const api::MemoryBudget::Claim> answer_memory_;  // until it is sent
};

Exchange::Exchange() {
  set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& out) {
    if (request.method == "POST") return HandlerResponse::Unhandled;  // its body is read first
    hand_over(respond(request, {}), out);
    return HandlerResponse::Handled;
  });
  // Nothing here throws but for lack of memory, and then httplib's own answer would not fit, either.
  set_exception_handler([](const httplib::Request&, httplib::Response&, const std::exception_ptr& error) {
    std::rethrow_exception(error);
  });
  set_error_handler([this](const httplib::Request&, httplib::Response& out) {
    if (answered_) return;
    close_ = true;
    hand_over(refusal_for(out.status), out);
  });
  set_post_routing_handler([this](const httplib::Request&, httplib::Response& out) {
    if (out.status == 304) out.headers.erase("Content-Length");  // httplib says 0; it would mean the representation's
    out.headers.erase("Keep-Alive");                             // promises a bound on requests that there isn't
    out.headers.erase("Connection");
    if (close_) out.set_header("Connection", "close");
  });
  set_logger([this](const httplib::Request&, const httplib::Response& out) {
    record_.status = out.status;
    record_.bytes = out.body.size();
  });
}

// Paths are the api's matter: its table answers with 405, Allow and the document, too.
void Exchange::take_posts() {
  Post(R"([\s\S]*)",
       [this](const httplib::Request& request, httplib::Response& out, const httplib::ContentReader& reader) {
         hand_over(respond(request, [&](const httplib::ContentReceiver& receive) { return reader(receive); }), out);
       });
}

void Exchange::hand_over(api::Response&& answer, httplib::Response& out) {
  answered_ = true;
  record_.error_code = answer.error_code;
  answer_memory_ = std::move(answer.memory);
  out.status = answer.status;
  for (const auto& [name, value] : answer.headers) out.set_header(name, value);
  out.set_header(kRequestId, record_.request_id);
  if (!answer.content_type.empty()) out.set_header("Content-Type", answer.content_type);
  out.set_header("Accept-Ranges", "none");
  out.body = std::move(answer.body);  // moved: a frame has tens of megabytes
}

bool Exchange::process() {
  bool closed = false;
  // cpp-httplib 0.18 also takes the addresses of both ends, only to pass them on.
  const auto process_in = [&](auto& library) {
    if constexpr (requires { library.process_request(*this, close_, closed, {}); })
      return library.process_request(*this, close_, closed, {});
    else
      return library.process_request(*this, "", 0, "", 0, close_, closed, {});
  };
  const bool written = process_in(*this);
  close_ = close_ || closed;
  return written;
}

// An answer to somebody who has no connection to be served on.
class AnswerText : private Exchange {
 public:
  explicit AnswerText(api::Response answer) : answer_(std::move(answer)) {
    close_ = true;
    record_.request_id = new_request_id();
    process();
  }
  const std::string& text() const { return text_; }

 private:
  api::Response respond(const httplib::Request&, const ReadBody&) override { return std::move(answer_); }
  ssize_t read(char* to, std::size_t size) override {
    const std::size_t part = request_.copy(to, size);
    request_.remove_prefix(part);
    return part > 0 ? static_cast<ssize_t>(part) : -1;
  }
  ssize_t write(const char* bytes, std::size_t size) override {
    text_.append(bytes, size);
    return static_cast<ssize_t>(size);
  }

  api::Response answer_;
  std::string_view request_ = "GET / HTTP/1.1\r\n\r\n";
  std::string text_;
};

}  // namespace

struct HttpServer::Impl {
  Impl(const HttpOptions& options_in, HttpServer::Handler handler_in, Observer observer_in);

  ListenerOptions listener_options() const;
  void serve(Connection& connection) noexcept;
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

namespace {

// One request of a connection, first byte to last.
class ConnectionExchange : private Exchange {
 public:
  ConnectionExchange(HttpServer::Impl& server, Connection& connection)
      : server_(server),
        connection_(connection),
        in_(connection, {server.options.max_body_bytes, server.options.idle_timeout, server.options.receive_timeout}) {}

  bool serve();  // false: the connection is over

 private:
  void begin();
  api::Response respond(const httplib::Request& request, const ReadBody& read_body) override;
  api::Response refuse(const HeadProblem& why) const;
  void receive_body(const ReadBody& read_body);
  api::Response work();
  ssize_t read(char* to, std::size_t size) override { return in_.read(to, size); }
  ssize_t write(const char* bytes, std::size_t size) override {
    written_bytes_ += size;
    return connection_.write({bytes, size}) ? static_cast<ssize_t>(size) : -1;
  }

  HttpServer::Impl& server_;
  Connection& connection_;
  RequestStream in_;
  std::size_t written_bytes_ = 0;             // head and body, sent or not
  Clock::time_point started_ = Clock::now();  // when the request was complete
  api::Request request_;
  api::MemoryBudget::Claim body_memory_;  // of the request's body
  std::atomic<bool> abandoned_{false};
};

bool ConnectionExchange::serve() {
  if (!in_.open()) return false;
  begin();
  const bool delivered = process() && connection_.flush();
  if (!delivered)  // the body's end is what was not sent
    record_.bytes -= std::min(record_.bytes, written_bytes_ - std::min(written_bytes_, connection_.sent_bytes()));
  record_.seconds = seconds(Clock::now() - started_);
  server_.observe(record_);
  if (delivered && !close_) return true;
  connection_.end_work();
  if (delivered) connection_.linger(kLinger);
  return false;
}

// What the record says of a request that is refused, too.
void ConnectionExchange::begin() {
  const RequestHead& head = in_.head();
  record_.method = request_.method = head.method;
  record_.target = head.target;
  record_.path = head.target.substr(0, head.target.find('?'));  // until it is decoded
  record_.request_id = request_id_of(head.headers);
  record_.host = connection_.peer().host;
  if (is_trusted_proxy(connection_.peer().host, server_.options.trusted_proxies))
    record_.token = token_of(head.headers);
  if (!in_.problem()) {
    if (auto problem = server_.hosts.refusal(head, connection_.peer().local)) in_.refuse(std::move(*problem));
  }
  close_ = head.close;
  if (head.method == "POST" && !in_.problem()) take_posts();
}

api::Response ConnectionExchange::respond(const httplib::Request& request, const ReadBody& read_body) {
  if (read_body) receive_body(read_body);
  started_ = Clock::now();
  if (in_.problem()) {
    close_ = true;
    return refuse(*in_.problem());
  }
  record_.request_bytes = request_.body.size();
  record_.path = request_.path = request.path;
  request_.query = request.params;
  request_.headers = in_.head().headers;
  if (connection_.begin_work()) return work();
  close_ = true;  // given up a moment ago: nobody to answer
  return api::problem("busy", "the connection was given up");
}

api::Response ConnectionExchange::refuse(const HeadProblem& why) const {
  if (why.error_code == "busy") return api::retry_problem(why.error_code, why.detail, server_.options.retry_after_s());
  return api::problem(why.error_code, why.detail);
}

// The only place where a body grows.
void ConnectionExchange::receive_body(const ReadBody& read_body) {
  auto claim = server_.options.bodies->try_claim(0);
  if (claim) body_memory_ = std::move(*claim);
  std::string& body = request_.body;
  const auto fits = [&] {
    if (body.size() < kFreeBody_bytes) return claim.has_value();
    return claim && (body.capacity() <= body_memory_.bytes() || body_memory_.try_resize(body.capacity()));
  };
  const bool whole = read_body([&](const char* bytes, std::size_t size) {
    if (!fits()) {
      in_.refuse({"busy", "the memory for requests that are arriving is in use by others"});
      return false;
    }
    body.append(bytes, size);
    return true;
  });
  if (!whole && !in_.problem()) in_.refuse({"malformed_request", "the body could not be read"});
}

api::Response ConnectionExchange::work() {
  request_.received = Clock::now();
  request_.abandoned = &abandoned_;
  Peer peer = connection_.peer();
  if (!record_.token.empty()) {
    peer.address = "token " + record_.token;
    peer.number = 0;  // a proxy's connections carry anybody's requests
  }
  Clock::duration queued{};
  api::Response response;
  {
    const DepartureWatch::Guard watch(server_.departures, connection_.fd(), !in_.head().http_1_0, &abandoned_);
    response = server_.handler(request_, peer, queued);
  }
  record_.queued_s = seconds(queued);
  const double total_s = seconds(Clock::now() - request_.received);
  record_.work_s = total_s - record_.queued_s;
  record_.stages_ms = complete_timing(response, 1e3 * total_s);
  request_.body = {};  // a slow reader keeps its answer, and nothing else
  body_memory_ = {};
  connection_.begin_answer();
  // A reserved connection stays one: who was refused on it comes back on another, and leaves it to the next.
  close_ = close_ || server_.listener.stopping() || connection_.peer().reserved;
  if (response.error_code == api::kOutOfMemory && response.body.empty()) throw std::bad_alloc();
  return response;
}

}  // namespace

HttpServer::Impl::Impl(const HttpOptions& options_in, HttpServer::Handler handler_in, Observer observer_in)
    : options(options_in),
      hosts(options.host, options.allowed_hosts),
      handler(std::move(handler_in)),
      observer(std::move(observer_in)),
      spare_answer(AnswerText(api::retry_problem(std::string(api::kOutOfMemory), "not enough memory for this request",
                                                 kSpareRetryAfter_s))
                       .text()),
      listener(listener_options()) {}

ListenerOptions HttpServer::Impl::listener_options() const {
  const auto busy = [this] {
    return AnswerText(api::retry_problem("busy", "too many connections", options.retry_after_s())).text();
  };
  return {options.host, options.port, options.max_connections, options.send_pace, busy, spare_answer};
}

void HttpServer::Impl::serve(Connection& connection) noexcept {
  try {
    while (!listener.stopping() && ConnectionExchange(*this, connection).serve()) connection.end_work();
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
