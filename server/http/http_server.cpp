#include "server/http/http_server.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <list>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <utility>

#include "api/message/problem.h"
#include "api/message/timing.h"
#include "api/message/version.h"
#include "dem/base/names.h"
#include "server/http/connection.h"

namespace selenograph::server {
namespace {

constexpr auto kPollInterval = std::chrono::milliseconds(100);
constexpr int kOn = 1;
constexpr std::size_t kMaxHeadBytes = 16384;
constexpr std::size_t kMaxFramingBytes = 65536;  // of a body in chunks
// Threads for connections beyond the limit: health and metrics are answered, all others refused.
constexpr int kReservedConnections = 8;
constexpr auto kReservedTime = std::chrono::milliseconds(2000);  // for a head on a reserved connection
// The library would act on these headers, but ranges, content codings and forms are not offered.
constexpr const char* kHiddenHeaders[] = {"Range", "If-Range", "Accept-Encoding", "Content-Type"};

double seconds(HttpServer::Clock::duration time) { return std::chrono::duration<double>(time).count(); }

// One request of a connection, from its first byte to the last of its answer. The library carries a reference to it
// from take_head() to the handlers, as a callable in a member of its request that only its client uses.
struct Exchange {
  Connection& connection;
  const bool is_reserved;
  AccessRecord record{};
  api::Request request{};
  httplib::Request* received = nullptr;
  std::optional<api::Response> refusal{};
  std::shared_ptr<const void> answer_memory{};  // held until the answer is sent
  bool close = false;                           // close the connection after the answer
  bool operator()(const httplib::Response&) const { return true; }
};

// Returns null for a request whose head the library has refused.
Exchange* exchange_of(const httplib::Request& request) {
  const auto* carrier = request.response_handler.target<std::reference_wrapper<Exchange>>();
  return carrier ? &carrier->get() : nullptr;
}

}  // namespace

// One cpp-httplib server: the library accepts, parses, routes and writes, each connection on a thread of its pool. This
// class adds deadlines and clients that leave (Connection), access by Host and Origin, connections in reserve, and
// problems. A request's way, all on its connection's thread; indented calls are made by the line above:
//
//   serve_request
//     httplib process_request          reads the head from the Connection, later the body, and writes the answer
//       take_head                      checks the head, and hides headers from the library
//       pre-routing handler            a refused request, or one without a body: answer
//       POST handler                   a request whose body is complete: answer
//       error handler                  the library refused the request
class HttpServer::Library : public HttpServer, private httplib::Server {
 public:
  using HttpServer::Handler;
  Library(const HttpOptions& options, Handler handler, Observer observer)
      : options_(options), handler_(std::move(handler)), observer_(std::move(observer)) {
    const auto threads = static_cast<std::size_t>(options.max_connections + kReservedConnections);
    new_task_queue = [threads] { return new httplib::ThreadPool(threads); };
    set_payload_max_length(options.max_body_bytes);
    set_tcp_nodelay(true);
    // Set only SO_REUSEADDR: with SO_REUSEPORT, the library's default, a second service could share the port unnoticed.
    set_socket_options([](socket_t socket) { ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &kOn, sizeof kOn); });
    set_handlers();
    errno = 0;
    port_ = options.port != 0 ? options.port : bind_to_any_port(options.host);
    if (port_ < 0 || (options.port != 0 && !bind_to_port(options.host, options.port)))
      throw std::runtime_error(fmt::format("cannot listen on {} port {}: {}", options.host, options.port,
                                           errno != 0 ? std::strerror(errno) : "unknown host"));
    ::listen(svr_sock_, SOMAXCONN);  // the library's backlog is only 5
  }

  int port() const override { return port_; }
  int connections() const override {
    const std::lock_guard lock(mutex_);
    return static_cast<int>(open_.size());
  }

  void run() override {
    if (!listen_after_bind() && !stopping_)
      throw std::runtime_error(fmt::format("cannot accept connections: {}", std::strerror(errno)));
  }

  bool stop(Clock::time_point deadline) override {
    stopping_ = true;
    ::shutdown(svr_sock_, SHUT_RDWR);  // accept() fails from now on, even if it has not been called yet
    for_all(&Connection::end_reading);
    while (connections() > 0 && Clock::now() < deadline) std::this_thread::sleep_for(kPollInterval / 10);
    const bool all_sent = connections() == 0;
    for_all(&Connection::cut);
    return all_sent;
  }

 private:
  // Routes all paths to one handler: the api's table of routes also decides on 404, 405 and Allow.
  void set_handlers() {
    set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& out) {
      Exchange& exchange = *exchange_of(request);
      if (request.method == "POST" && !exchange.refusal) return HandlerResponse::Unhandled;  // its body is read first
      answer(exchange, out);
      return HandlerResponse::Handled;
    });
    Post(R"([\s\S]*)", [this](const httplib::Request& request, httplib::Response& out) {
      Exchange& exchange = *exchange_of(request);
      exchange.request.body = std::move(exchange.received->body);
      if (exchange.request.body.size() <= options_.max_body_bytes) return answer(exchange, out);
      out.status = 413;  // the library does not limit a body in chunks
    });
    set_error_handler([this](const httplib::Request& request, httplib::Response& out) {
      Exchange* const exchange = exchange_of(request);
      if (exchange && exchange->record.status != 0) return;  // answered
      const bool is_too_large = out.status == 413 || (exchange && exchange->connection.is_at_limit());
      const std::string_view code = out.status == 500   ? api::kOutOfMemory  // the only exception that gets here
                                    : out.status == 414 ? "uri_too_long"
                                    : is_too_large      ? "too_large"
                                    : exchange && exchange->connection.is_late() ? "request_timeout"
                                                                                 : "malformed_request";
      api::Response problem = api::problem(
          std::string(code), "the request did not arrive whole, as HTTP/1.1, within its limits and in time");
      out.headers.clear();
      if (exchange) {
        exchange->close = true;
        return hand_over(*exchange, std::move(problem), out);
      }
      AccessRecord record{.status = problem.status, .bytes = problem.body.size(), .error_code = problem.error_code};
      record.request_id = new_request_id();
      observer_(record);
      out.status = problem.status;
      out.set_header("X-Request-Id", record.request_id);
      out.set_content(problem.body, problem.content_type);
    });
    set_post_routing_handler([](const httplib::Request& request, httplib::Response& out) {
      const Exchange* const exchange = exchange_of(request);
      if (out.status == 304) out.headers.erase("Content-Length");  // 0 would contradict the representation's length
      out.headers.erase("Keep-Alive");                             // states a limit of requests that does not exist
      if (exchange && !exchange->close) return;
      if (!out.has_header("Connection")) out.set_header("Connection", "close");
    });
  }

  // Serves the requests of a connection, one after the other, until it ends or the server stops.
  bool process_and_close_socket(socket_t socket) override {
    Connection connection(socket);
    std::unique_lock lock(mutex_);
    open_.push_back(&connection);
    const bool is_reserved = std::ssize(open_) > options_.max_connections;
    lock.unlock();
    try {
      do {
        connection.limit_time(is_reserved ? kReservedTime : options_.idle_time);
      } while (!stopping_ && connection.wait_for_request() && serve_request(connection, is_reserved));
    } catch (const std::exception&) {  // no memory for the exchange: the connection ends
    }
    lock.lock();
    open_.remove(&connection);
    return true;  // the library ignores it
  }

  void for_all(void (Connection::*call)()) {
    const std::lock_guard lock(mutex_);
    for (Connection* connection : open_) (connection->*call)();
  }

  // Lets the library read, route and answer one request. Returns false when the connection ends with it.
  bool serve_request(Connection& connection, bool is_reserved) {
    Exchange exchange{.connection = connection, .is_reserved = is_reserved};
    connection.limit_time(is_reserved ? kReservedTime : options_.receive_time);
    connection.limit_bytes(kMaxHeadBytes);
    bool is_last = false;
    const auto take = [&](httplib::Request& request) { take_head(exchange, request); };
    // cpp-httplib 0.18 also takes the addresses of both ends, which it only passes on.
    const auto process_in = [&](auto& library) {
      if constexpr (requires { library.process_request(connection, false, is_last, take); })
        return library.process_request(connection, false, is_last, take);
      else
        return library.process_request(connection, "", 0, "", 0, false, is_last, take);
    };
    const bool is_delivered = process_in(*this);
    exchange.answer_memory.reset();
    const bool is_taken = exchange.record.status != 0;  // else the library has refused the head
    exchange.record.seconds = seconds(Clock::now() - exchange.request.received);
    if (is_taken) observer_(exchange.record);
    const bool is_open = is_delivered && is_taken && !exchange.close && !is_last;
    if (is_delivered && !is_open) connection.linger();
    return is_open;
  }

  // Checks the parsed head, and removes the headers on which the library would act.
  void take_head(Exchange& exchange, httplib::Request& request) const {
    request.response_handler = std::ref(exchange);
    exchange.received = &request;
    AccessRecord& record = exchange.record;
    Headers& headers = exchange.request.headers;
    for (const auto& [name, value] : request.headers) headers.emplace(dem::lower(name), value);
    record.method = exchange.request.method = request.method;
    record.target = request.target;
    for (char& c : record.target) c = static_cast<unsigned char>(c) < ' ' ? '?' : c;
    record.path = exchange.request.path = request.path;
    exchange.request.query = request.params;
    record.request_id = plain_name(headers, "x-request-id");
    if (record.request_id.empty()) record.request_id = new_request_id();
    record.host = exchange.connection.remote_address;
    if (is_loopback(record.host) || std::ranges::count(options_.trusted_proxies, record.host) > 0)
      record.token = plain_name(headers, "selenograph-token");
    exchange.refusal = refusal_of(exchange, request);
    const std::string length = request.get_header_value("Content-Length");
    const bool has_body = request.has_header("Transfer-Encoding") || (!length.empty() && length != "0");
    // The body of a method other than POST is never read, and must not be taken for the next request.
    exchange.close = exchange.refusal || (request.method != "POST" && has_body);
    for (const char* name : kHiddenHeaders) request.headers.erase(name);
    request.ranges.clear();
    if (exchange.refusal) request.headers.erase("Expect");
    if (!has_body) request.set_header("Content-Length", "0");  // else the library reads until the end of the stream
    exchange.connection.limit_bytes(options_.max_body_bytes + kMaxFramingBytes);
  }

  // Returns nothing if the head is accepted. Framing is the library's: see server/http/README.md.
  std::optional<api::Response> refusal_of(const Exchange& exchange, const httplib::Request& request) const {
    if (exchange.is_reserved && std::ranges::count(options_.reserved_paths, request.path) == 0)
      return api::problem("busy", "too many connections");
    const bool is_one_host = request.get_header_value_count("Host") == 1 && !request.get_header_value("Host").empty();
    if (!is_one_host && (request.version != "HTTP/1.0" || request.has_header("Host")))
      return api::problem("malformed_request", "exactly one Host header is needed");
    if (request.has_header("Content-Encoding"))
      return api::problem("unsupported_media_type", "bodies with a Content-Encoding are not taken");
    // Without a number strtoull() returns 0, and the library refuses the length.
    if (std::strtoull(request.get_header_value("Content-Length").c_str(), nullptr, 10) > options_.max_body_bytes)
      return api::problem("too_large", fmt::format("the body has more than {} bytes", options_.max_body_bytes));
    const std::vector<std::string> own_hosts{"localhost", "127.0.0.1", "::1", options_.host,
                                             exchange.connection.local_address};
    return refusal_by_host(exchange.request.headers, own_hosts, options_.allowed_hosts);
  }

  // Answers a request that is complete or refused, and measures the times of the service's handler.
  void answer(Exchange& exchange, httplib::Response& out) const {
    AccessRecord& record = exchange.record;
    api::Request& request = exchange.request;
    request.received = Clock::now();
    if (exchange.refusal) return hand_over(exchange, std::move(*exchange.refusal), out);
    record.request_bytes = request.body.size();
    request.abandoned = &exchange.connection.abandoned();
    request.peer = record.host;
    request.client = record.token.empty() ? record.host : "token " + record.token;
    api::Response response = handler_(request);
    const double total_s = seconds(Clock::now() - request.received);
    record.queued_s = seconds(response.queued);
    record.work_s = total_s - record.queued_s;
    if (!response.stages.empty()) api::complete_timing(response.stages, 1e3 * total_s);
    request.body = {};  // while a slow client reads its answer, its request holds no memory
    hand_over(exchange, std::move(response), out);
  }

  // Records the answer, and moves it into the library's response.
  void hand_over(Exchange& exchange, api::Response&& answer, httplib::Response& out) const {
    AccessRecord& record = exchange.record;
    exchange.close = exchange.close || stopping_ || exchange.is_reserved;
    exchange.answer_memory = std::move(answer.memory);
    exchange.connection.limit_time(options_.answer_time);
    record.status = out.status = answer.status;
    record.bytes = answer.body.size();
    record.error_code = answer.error_code;
    record.stages = answer.stages;
    for (const auto& [name, value] : answer.headers) out.set_header(name, value);
    out.set_header("X-Request-Id", record.request_id);
    if (!answer.stages.empty()) out.set_header("Server-Timing", api::timing_text(answer.stages));
    if (!answer.content_type.empty()) out.set_header("Content-Type", answer.content_type);
    out.set_header("Accept-Ranges", "none");
    out.set_header("Server", fmt::format("selenograph/{}", api::software_version()));
    out.body = std::move(answer.body);  // moved: a frame has tens of megabytes
  }

  const HttpOptions options_;
  const Handler handler_;
  const Observer observer_;
  int port_;
  std::atomic<bool> stopping_{false};
  mutable std::mutex mutex_;
  std::list<Connection*> open_;
  // Detects clients that have left, but not after stop() has ended reading, when all seem to have. It is the last
  // member: the thread reads the others until it ends.
  const std::jthread detection_{[this](const std::stop_token& ending) {
    for (; !ending.stop_requested(); std::this_thread::sleep_for(kPollInterval)) {
      const std::lock_guard lock(mutex_);
      for (Connection* connection : open_)
        if (!stopping_) connection->detect_disconnect();
    }
  }};
};

std::unique_ptr<HttpServer> HttpServer::make(const HttpOptions& options, Handler handler, Observer observer) {
  return std::make_unique<Library>(options, std::move(handler), std::move(observer));
}

}  // namespace selenograph::server
