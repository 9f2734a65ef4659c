#include "server/http/http_server.h"

// Debian's cpp-httplib is a compiled library, and macros determine the layout of its classes. `pkg-config --cflags
// cpp-httplib` gives the macros that it was built with.
#if !defined(CPPHTTPLIB_OPENSSL_SUPPORT) || !defined(CPPHTTPLIB_ZLIB_SUPPORT) || !defined(CPPHTTPLIB_BROTLI_SUPPORT)
#error "compile with the flags of pkg-config --cflags cpp-httplib"
#endif
#include <fcntl.h>
#include <fmt/format.h>
#include <httplib.h>
#include <netinet/tcp.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <new>
#include <stdexcept>
#include <thread>

#include "api/message/problem.h"
#include "api/message/timing.h"
#include "api/message/version.h"
#include "dem/base/names.h"
#include "server/http/allowed_hosts.h"
#include "server/http/caller.h"
#include "server/http/connection.h"
#include "server/http/connections.h"
#include "server/http/request_head.h"

// A request's way, all on its connection's thread. Indented calls are made by the line above them:
//
//   serve_request
//     Connection::begin_request          waits for the first byte
//     process
//       httplib process_request          reads request line and headers from LibraryStream
//         take_head                      checks them, and hides headers from the library
//         pre-routing handler            a refused request, or one without a body: respond
//         POST handler                   receive_body, then respond
//         error handler                  the library refused the request, or has no route
//         (library)                      writes head and body to LibraryStream, which gathers them
//     Connection::flush                  sends the rest
//     observe                            log and metrics
//
// respond calls work, which calls the service's handler; hand_over passes the answer to the library.

namespace selenograph::server {
namespace {

using Clock = Connection::Clock;
constexpr auto kLinger = std::chrono::milliseconds(2000);  // see Connection::linger()
constexpr auto kLingerOfAcceptingThread = std::chrono::milliseconds(500);
constexpr int kSpareRetryAfter_s = 5;           // of the answer that is prepared for a lack of memory
constexpr std::size_t kFreeBody_bytes = 65536;  // claims no memory: a connection may hold as much anyway
constexpr char kRequestId[] = "X-Request-Id";
// The library would act on these headers, but ranges, content codings and forms are not offered.
constexpr const char* kHiddenHeaders[] = {"Range", "If-Range", "Accept-Encoding", "Content-Type"};

double seconds(Clock::duration time) { return std::chrono::duration<double>(time).count(); }

// One request of a connection, from its first byte to the last of its answer.
struct Exchange {
  explicit Exchange(Connection& connection_in) : connection(connection_in) {
    record.request_id = new_request_id();
    record.host = connection.peer().host;
  }

  Connection& connection;
  AccessRecord record{};
  api::Request request{};
  std::optional<Refusal> refusal{};
  api::MemoryBudget::Claim body_memory{};
  std::shared_ptr<const api::MemoryBudget::Claim> answer_memory{};  // held until the answer is sent
  Clock::time_point started = Clock::now();                         // time of the complete request
  std::size_t written_bytes = 0;                                    // head and body, sent or not
  bool answered = false;                                            // by hand_over(); else the library refused it
  bool close = false;                                               // close the connection after the answer
};

// Exchange of this thread's request: the library passes nothing to its handlers that identifies the connection.
thread_local Exchange* current_exchange = nullptr;
// True while a connection is handled on the accepting thread, because no other thread could be started.
thread_local bool is_without_thread = false;

// Adapts a connection to the library's interface for reading and writing.
class LibraryStream : public httplib::Stream {
 public:
  explicit LibraryStream(Exchange& exchange) : exchange_(exchange) {}
  bool is_readable() const override { return true; }
  bool is_writable() const override { return true; }
  ssize_t read(char* to, std::size_t size) override { return exchange_.connection.read(to, size); }
  ssize_t write(const char* bytes, std::size_t size) override {
    exchange_.written_bytes += size;
    return exchange_.connection.write({bytes, size}) ? static_cast<ssize_t>(size) : -1;
  }
  // The library only compares it with FD_SETSIZE; poll() has no such bound.
  socket_t socket() const override { return 0; }
  void get_remote_ip_and_port(std::string&, int&) const override {}
  void get_local_ip_and_port(std::string&, int&) const override {}

 private:
  Exchange& exchange_;
};

// Returns the head as the client sent it, with header names in lower case.
RequestHead head_of(const httplib::Request& request) {
  RequestHead head{request.method, request.target, request.version == "HTTP/1.0", {}};
  for (const auto& [name, value] : request.headers) {
    // The library adds the connection's addresses as headers of these names.
    if (name.ends_with("_ADDR") || name.ends_with("_PORT")) continue;
    head.headers.emplace(dem::lower(name), value);
  }
  return head;
}

// Returns the row of the api's error table for a refusal by the library.
Refusal refusal_for(int status, const httplib::Request& request) {
  if (status == 404) return {"not_found", "no such resource"};
  if (status == 414) return {"uri_too_long", "the request target is too long"};
  if (status == 500) return {"internal", "the request could not be handled"};
  const bool is_known = is_http_method(request.method) || !request.version.starts_with("HTTP/1.");
  if (!is_known) return {"not_implemented", "no resource here has the method " + request.method.substr(0, 40)};
  return {"malformed_request", "not a well-formed HTTP/1.1 request"};
}

// Returns the text of an answer to a client whose request is not read to its end.
std::string last_answer(const api::Response& answer, std::string_view request_id) {
  std::string text = fmt::format("HTTP/1.1 {} {}\r\nAccept-Ranges: none\r\nConnection: close\r\n", answer.status,
                                 api::error_row(answer.error_code).title);
  for (const auto& [name, value] : answer.headers) text += fmt::format("{}: {}\r\n", name, value);
  text += fmt::format("{}: {}\r\nContent-Type: {}\r\nContent-Length: {}\r\n\r\n", kRequestId, request_id,
                      answer.content_type, answer.body.size());
  return text + answer.body;
}

}  // namespace

struct HttpServer::Impl : private httplib::Server {
 public:
  Impl(const HttpOptions& options_in, HttpServer::Handler handler_in, Observer observer_in);

  void run();
  void stop();

  const HttpOptions options;
  const AllowedHosts hosts;
  const HttpServer::Handler handler;
  const Observer observer;
  const std::string spare_answer;  // sent when there is no memory for another
  int port;
  std::atomic<bool> stopping{false};
  Connections connections;

 private:
  class ThreadPerConnection;
  void set_handlers();
  void bind(int at_port);
  bool process_and_close_socket(socket_t socket) override;
  void serve_or_refuse(Connection& connection);
  void serve(Connection& connection);
  bool serve_request(Connection& connection);
  bool process(Exchange& exchange);
  void take_head(Exchange& exchange, httplib::Request& request) const;
  api::Response respond(Exchange& exchange, const httplib::Request& request, const httplib::ContentReader* read_body);
  void receive_body(Exchange& exchange, const httplib::ContentReader& read_body) const;
  api::Response work(Exchange& exchange);
  api::Response refuse(const Refusal& why) const;
  void answer_without_memory(Connection& connection) noexcept;
  void observe(const AccessRecord& record) noexcept;
};

namespace {

// Records the answer, and moves it into the library's response.
void hand_over(Exchange& exchange, api::Response&& answer, httplib::Response& out) {
  exchange.answered = true;
  exchange.record.status = answer.status;
  exchange.record.bytes = answer.body.size();  // serve_request() subtracts what the client does not take
  exchange.record.error_code = answer.error_code;
  exchange.answer_memory = std::move(answer.memory);
  out.status = answer.status;
  for (const auto& [name, value] : answer.headers) out.set_header(name, value);
  out.set_header(kRequestId, exchange.record.request_id);
  if (!answer.stages.empty()) out.set_header("Server-Timing", api::timing_text(answer.stages));
  if (!answer.content_type.empty()) out.set_header("Content-Type", answer.content_type);
  out.set_header("Accept-Ranges", "none");
  out.set_header("Server", fmt::format("selenograph/{}", api::software_version()));
  out.body = std::move(answer.body);  // moved: a frame has tens of megabytes
}

}  // namespace

// Takes the place of the library's queue of accepted connections: none waits.
class HttpServer::Impl::ThreadPerConnection : public httplib::TaskQueue {
  using Enqueued = decltype(std::declval<httplib::TaskQueue&>().enqueue({}));  // bool since cpp-httplib 0.14

 public:
  explicit ThreadPerConnection(Connections& connections) : connections_(connections) {}
  Enqueued enqueue(std::function<void()> serve) override {
    try {
      connections_.start_thread(serve);
    } catch (const std::exception&) {  // no thread or no memory: refuse this client on the accepting thread
      is_without_thread = true;
      serve();
      is_without_thread = false;
    }
    return static_cast<Enqueued>(true);
  }
  void shutdown() override {}  // run() waits for the connections

 private:
  Connections& connections_;
};

HttpServer::Impl::Impl(const HttpOptions& options_in, HttpServer::Handler handler_in, Observer observer_in)
    : options(options_in),
      hosts(options.host, options.allowed_hosts),
      handler(std::move(handler_in)),
      observer(std::move(observer_in)),
      spare_answer(last_answer(
          api::retry_problem(std::string(api::kOutOfMemory), "not enough memory for this request", kSpareRetryAfter_s),
          new_request_id())),
      port(options.port),
      connections(options.max_connections) {
  new_task_queue = [this] { return new ThreadPerConnection(connections); };
  // Set only SO_REUSEADDR: with SO_REUSEPORT, the library's default, a second service could share the port unnoticed.
  set_socket_options([](socket_t socket) {
    const int on = 1;
    ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  });
  set_handlers();
  bind(options.port);
}

void HttpServer::Impl::bind(int at_port) {
  errno = 0;
  port = at_port == 0 ? bind_to_any_port(options.host) : bind_to_port(options.host, at_port) ? at_port : -1;
  if (port < 0)
    throw std::runtime_error(fmt::format("cannot listen on {} port {}: {}", options.host, at_port,
                                         errno != 0 ? std::strerror(errno) : "unknown host"));
  ::listen(svr_sock_, SOMAXCONN);  // the library's backlog is only 5
}

// Routes all paths to one handler: the api's table of routes also decides on 404, 405 and Allow.
void HttpServer::Impl::set_handlers() {
  set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& out) {
    Exchange& exchange = *current_exchange;
    if (request.method == "POST" && !exchange.refusal) return HandlerResponse::Unhandled;  // its body is read first
    hand_over(exchange, respond(exchange, request, nullptr), out);
    return HandlerResponse::Handled;
  });
  Post(R"([\s\S]*)",
       [this](const httplib::Request& request, httplib::Response& out, const httplib::ContentReader& read_body) {
         hand_over(*current_exchange, respond(*current_exchange, request, &read_body), out);
       });
  // Handlers throw only for lack of memory, when the library's own answer would not fit, either.
  set_exception_handler([](const httplib::Request&, httplib::Response&, const std::exception_ptr& error) {
    std::rethrow_exception(error);
  });
  set_error_handler([this](const httplib::Request& request, httplib::Response& out) {
    Exchange& exchange = *current_exchange;
    if (exchange.answered) return;
    exchange.close = true;
    if (exchange.record.method.empty()) {
      exchange.record.method = request.method;
      if (!has_control(request.target)) exchange.record.target = request.target;
    }
    const auto& problem = exchange.connection.problem();
    hand_over(exchange, refuse(problem ? *problem : refusal_for(out.status, request)), out);
  });
  set_post_routing_handler([](const httplib::Request&, httplib::Response& out) {
    if (out.status == 304) out.headers.erase("Content-Length");  // 0 would contradict the representation's length
    out.headers.erase("Keep-Alive");                             // states a limit of requests that does not exist
    out.headers.erase("Connection");
    if (current_exchange->close) out.set_header("Connection", "close");
  });
}

// Listens again after an error of accept(), which may concern a single client and must not end the service.
void HttpServer::Impl::run() {
  while (!listen_after_bind() && !stopping) {
    spdlog::warn("accept() failed, listening again: {}", std::strerror(errno));
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    bind(port);
  }
  connections.close_waiting();
  connections.wait_until_done(Clock::time_point::max());
}

void HttpServer::Impl::stop() {
  stopping = true;
  ::shutdown(svr_sock_, SHUT_RDWR);  // accept() fails from now on, even if it has not been called yet
  connections.close_waiting();
}

bool HttpServer::Impl::process_and_close_socket(socket_t socket) {
  const int on = 1;
  ::fcntl(socket, F_SETFD, FD_CLOEXEC);
  ::setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
  bool has_owner = false;
  try {
    Connection connection(socket, peer_of(socket), options.send_pace);
    has_owner = true;
    if (is_without_thread) {
      // Linger, although this thread accepts nobody meanwhile: a reset would discard the answer of a client that is
      // still sending.
      if (connection.write_without_memory(spare_answer)) connection.linger(kLingerOfAcceptingThread);
    } else {
      serve_or_refuse(connection);
    }
  } catch (const std::bad_alloc&) {
    if (!has_owner) ::close(socket);  // no memory even for the Connection, which would have closed it
  }
  return true;  // the library ignores it
}

// Refuses the connection if all connections are at work.
void HttpServer::Impl::serve_or_refuse(Connection& connection) {
  bool is_added = false;
  try {
    is_added = connections.add(connection);
    if (!is_added && connection.write(last_answer(refuse({"busy", "too many connections"}), new_request_id())) &&
        connection.flush())
      connection.linger(kLinger);
  } catch (const std::bad_alloc&) {
    answer_without_memory(connection);
  }
  if (!is_added) return;
  serve(connection);
  connections.remove(connection);
}

// Serves the requests of a connection, one after the other, until it ends or the server stops.
void HttpServer::Impl::serve(Connection& connection) {
  try {
    while (!stopping && serve_request(connection)) connection.end_work();
  } catch (...) {
    answer_without_memory(connection);
  }
  current_exchange = nullptr;
}

// Serves one request. Returns false when the connection ends with it.
bool HttpServer::Impl::serve_request(Connection& connection) {
  if (!connection.begin_request(options.idle_timeout, options.receive_timeout)) return false;
  Exchange exchange(connection);
  bool delivered = process(exchange);
  AccessRecord& record = exchange.record;
  if (!exchange.answered) {  // the library could not read a request line
    if (!connection.problem()) return false;
    const api::Response answer = refuse(*connection.problem());
    record.status = answer.status;
    record.error_code = answer.error_code;
    exchange.close = true;
    delivered = connection.write(last_answer(answer, record.request_id));
  }
  delivered = delivered && connection.flush();
  if (!delivered) {
    // The unsent bytes are the end of the body: subtract them from its size.
    const std::size_t unsent_bytes = exchange.written_bytes - std::min(exchange.written_bytes, connection.sent_bytes());
    record.bytes -= std::min(record.bytes, unsent_bytes);
  }
  record.seconds = seconds(Clock::now() - exchange.started);
  observe(record);
  if (delivered && !exchange.close) return true;
  connection.end_work();
  if (delivered) connection.linger(kLinger);
  return false;
}

// Lets the library read, route and answer one request. Returns false if the answer could not be written.
bool HttpServer::Impl::process(Exchange& exchange) {
  current_exchange = &exchange;
  LibraryStream stream(exchange);
  bool closed = false;
  const auto take = [&](httplib::Request& request) { take_head(exchange, request); };
  // cpp-httplib 0.18 also takes the addresses of both ends, which it only passes on.
  const auto process_in = [&](auto& library) {
    if constexpr (requires { library.process_request(stream, false, closed, take); })
      return library.process_request(stream, false, closed, take);
    else
      return library.process_request(stream, "", 0, "", 0, false, closed, take);
  };
  return process_in(*this);
}

// Checks the parsed head, and removes the headers on which the library would act.
void HttpServer::Impl::take_head(Exchange& exchange, httplib::Request& request) const {
  exchange.connection.end_head();
  RequestHead head = head_of(request);
  const std::string target = resolve_authority(head);
  if (target != head.target) request.path = httplib::detail::decode_url(target.substr(0, target.find('?')), false);
  AccessRecord& record = exchange.record;
  record.method = exchange.request.method = head.method;
  if (!has_control(target)) record.target = target;
  record.path = record.target.substr(0, record.target.find('?'));  // respond() sets the decoded path
  record.request_id = request_id_of(head.headers);
  if (is_trusted_proxy(record.host, options.trusted_proxies)) record.token = token_of(head.headers);
  exchange.refusal = refusal_of(head, options.max_body_bytes);
  if (!exchange.refusal) exchange.refusal = hosts.refusal(head, exchange.connection.peer().local);
  exchange.close = exchange.refusal || ends_connection(head);
  for (const char* name : kHiddenHeaders) request.headers.erase(name);
  request.ranges.clear();
  const bool is_body_read = head.method == "POST" && !exchange.refusal;
  if (!is_body_read || !announces_body(head) || head.http_1_0) request.headers.erase("Expect");
  if (is_body_read && !announces_body(head))
    request.set_header("Content-Length", "0");  // else read until the end of stream
  exchange.request.headers = std::move(head.headers);
}

// Returns the answer to a request whose head has been taken. `read_body` reads the body; null: the request has none.
api::Response HttpServer::Impl::respond(Exchange& exchange, const httplib::Request& request,
                                        const httplib::ContentReader* read_body) {
  if (read_body) receive_body(exchange, *read_body);
  exchange.started = Clock::now();
  if (exchange.refusal) {
    exchange.close = true;
    return refuse(*exchange.refusal);
  }
  exchange.record.request_bytes = exchange.request.body.size();
  exchange.record.path = exchange.request.path = request.path;
  exchange.request.query = request.params;
  if (exchange.connection.begin_work()) return work(exchange);
  exchange.close = true;  // given up meanwhile: the client gets no answer
  return api::problem("busy", "the connection was given up");
}

// Returns the problem document of a refusal.
api::Response HttpServer::Impl::refuse(const Refusal& why) const {
  if (why.error_code == "busy") return api::retry_problem(why.error_code, why.detail, options.retry_after_s());
  return api::problem(why.error_code, why.detail);
}

// Receives the body within its limits of size and memory; bodies grow nowhere else.
void HttpServer::Impl::receive_body(Exchange& exchange, const httplib::ContentReader& read_body) const {
  // Claim nothing at first: the claim grows with the body's capacity. Without a claim, the body is refused.
  auto claim = options.bodies->try_claim(0);
  if (claim) exchange.body_memory = std::move(*claim);
  std::string& body = exchange.request.body;
  // Returns true if the memory of the body received so far is claimed.
  const auto fits = [&] {
    if (body.size() < kFreeBody_bytes) return claim.has_value();
    return claim &&
           (body.capacity() <= exchange.body_memory.bytes() || exchange.body_memory.try_resize(body.capacity()));
  };
  const bool is_complete = read_body([&](const char* bytes, std::size_t size) {
    if (!fits())
      exchange.refusal = Refusal{"busy", "the memory for request bodies is in use by other requests"};
    else if (size > options.max_body_bytes - body.size())
      exchange.refusal = Refusal{"too_large", fmt::format("the body is longer than {} bytes", options.max_body_bytes)};
    else
      body.append(bytes, size);
    return !exchange.refusal;
  });
  if (is_complete || exchange.refusal) return;
  exchange.refusal = exchange.connection.problem();
  if (!exchange.refusal) exchange.refusal = Refusal{"malformed_request", "the body could not be read"};
}

// Runs the service's handler, and measures its times.
api::Response HttpServer::Impl::work(Exchange& exchange) {
  AccessRecord& record = exchange.record;
  exchange.request.received = Clock::now();
  exchange.request.abandoned = &exchange.connection.abandoned();
  Peer peer = exchange.connection.peer();
  if (!record.token.empty()) peer.client = "token " + record.token;
  Clock::duration queued{};
  api::Response response = handler(exchange.request, peer, queued);
  record.queued_s = seconds(queued);
  const double total_s = seconds(Clock::now() - exchange.request.received);
  record.work_s = total_s - record.queued_s;
  if (!response.stages.empty()) api::complete_timing(response.stages, 1e3 * total_s);
  record.stages = response.stages;
  exchange.request.body = {};  // while a slow client reads its answer, its request holds no memory
  exchange.body_memory = {};
  exchange.close = exchange.close || stopping;
  // Without memory for a problem document, serve() sends the prepared answer.
  if (response.error_code == api::kOutOfMemory && response.body.empty()) throw std::bad_alloc();
  return response;
}

// Sends the prepared answer, unless a part of another one has already been sent.
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
  } catch (...) {  // no memory to count or log it
  }
}

HttpServer::HttpServer(const HttpOptions& options, Handler handler, Observer observer)
    : impl_(std::make_unique<Impl>(options, std::move(handler), std::move(observer))) {}
HttpServer::~HttpServer() = default;

int HttpServer::port() const { return impl_->port; }
int HttpServer::connections() const { return impl_->connections.size(); }
std::string HttpServer::url() const {
  const std::string& host = impl_->options.host;
  const bool is_ipv6 = host.find(':') != std::string::npos;
  return "http://" + (is_ipv6 ? '[' + host + ']' : host) + ':' + std::to_string(port());
}
void HttpServer::run() { impl_->run(); }
void HttpServer::stop() { impl_->stop(); }
bool HttpServer::wait_until_done(Clock::time_point deadline) { return impl_->connections.wait_until_done(deadline); }
void HttpServer::cut() { impl_->connections.cut(); }

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
