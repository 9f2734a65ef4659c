#include "server/http/http_server.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "api/message/problem.h"
#include "api/message/timing.h"
#include "api/message/version.h"
#include "dem/base/names.h"

// A request's way, all on its connection's thread. Indented calls are made by the line above them:
//
//   serve_request
//     httplib process_request          reads request line and headers from the Connection
//       take_head                      checks them, and hides headers from the library
//       pre-routing handler            a refused request, or one without a body: answer
//       POST handler                   receive_body, then answer
//       error handler                  the library refused the request
//       (library)                      writes head and body to the Connection
//     observe                          log and metrics

namespace selenograph::server {
namespace {

using Clock = HttpServer::Clock;
constexpr auto kDetectionInterval = std::chrono::milliseconds(250);  // of clients that have disconnected
constexpr std::size_t kMaxHeadBytes = 16384, kMaxTargetBytes = 2048;
constexpr std::size_t kMaxFramingBytes = 65536;  // of a body in chunks, in addition to as many as the body's limit
// Threads for connections beyond the limit: health and metrics are answered, all others refused.
constexpr int kReservedConnections = 8;
constexpr auto kReservedTime = std::chrono::milliseconds(2000);  // for a head on a reserved connection
// The library would act on these headers, but ranges, content codings and forms are not offered.
constexpr const char* kHiddenHeaders[] = {"Range", "If-Range", "Accept-Encoding", "Content-Type"};

double seconds(Clock::duration time) { return std::chrono::duration<double>(time).count(); }

// Returns the headers as the client sent them, with names in lower case.
Headers headers_of(const httplib::Request& request) {
  Headers headers;
  for (const auto& [name, value] : request.headers) {
    // The library adds the connection's addresses as headers of these names.
    if (!name.ends_with("_ADDR") && !name.ends_with("_PORT")) headers.emplace(dem::lower(name), value);
  }
  return headers;
}

// Returns the value of Content-Length; 0 without one.
std::uint64_t length_of(const Headers& headers) {
  const auto length = headers.find("content-length");
  std::uint64_t bytes = 0;
  if (length == headers.end()) return 0;
  const char* const end = length->second.data() + length->second.size();
  const bool is_number = std::from_chars(length->second.data(), end, bytes).ptr == end;
  return is_number ? bytes : std::numeric_limits<std::uint64_t>::max();
}

bool has_control(std::string_view text) {
  return std::ranges::any_of(text, [](unsigned char c) { return c < 32 || c == 127; });
}

// Writes an answer to the library's response. A request whose head was refused has no id.
void write(api::Response&& answer, const std::string& request_id, httplib::Response& out) {
  out.status = answer.status;
  for (const auto& [name, value] : answer.headers) out.set_header(name, value);
  if (!request_id.empty()) out.set_header("X-Request-Id", request_id);
  if (!answer.stages.empty()) out.set_header("Server-Timing", api::timing_text(answer.stages));
  if (!answer.content_type.empty()) out.set_header("Content-Type", answer.content_type);
  out.set_header("Accept-Ranges", "none");
  out.set_header("Server", fmt::format("selenograph/{}", api::software_version()));
  out.body = std::move(answer.body);  // moved: a frame has tens of megabytes
}

}  // namespace

// One request of a connection, from its first byte to the last of its answer.
struct HttpServer::Exchange {
  Exchange(Connection& connection_in, bool is_reserved_in) : connection(connection_in), is_reserved(is_reserved_in) {
    record.request_id = request_id_of({});
    record.host = connection.remote_address();
  }

  Connection& connection;
  const bool is_reserved;  // the connection is beyond the limit
  AccessRecord record{};
  api::Request request{};
  std::optional<Refusal> refusal{};
  std::shared_ptr<const void> answer_memory{};  // held until the answer is sent
  Clock::time_point started = Clock::now();     // time of the complete request
  bool answered = false;                        // by hand_over(); else the library refused it
  bool close = false;                           // close the connection after the answer
};

// Carries the exchange from take_head() to the handlers, in a member of the library's request that only its client
// uses.
struct HttpServer::ExchangeCarrier {
  Exchange* exchange;
  bool operator()(const httplib::Response&) const { return true; }
};

// Returns null for a request whose head the library has refused.
HttpServer::Exchange* HttpServer::exchange_of(const httplib::Request& request) {
  const auto* carrier = request.response_handler.target<ExchangeCarrier>();
  return carrier ? carrier->exchange : nullptr;
}

HttpServer::HttpServer(const HttpOptions& options, Handler handler, Observer observer)
    : options_(options),
      hosts_(options.host, options.allowed_hosts),
      handler_(std::move(handler)),
      observer_(std::move(observer)),
      port_(options.port) {
  const auto threads = static_cast<std::size_t>(options.max_connections + kReservedConnections);
  new_task_queue = [threads] { return new httplib::ThreadPool(threads); };
  set_payload_max_length(options.max_body_bytes);
  // Set only SO_REUSEADDR: with SO_REUSEPORT, the library's default, a second service could share the port unnoticed.
  set_socket_options([](socket_t socket) {
    const int on = 1;
    ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  });
  set_handlers();
  bind(options.port);
  detection_ = std::thread([this] { detect_disconnected_clients(); });
}

HttpServer::~HttpServer() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
    changed_.notify_all();
  }
  detection_.join();
}

void HttpServer::bind(int at_port) {
  errno = 0;
  port_ = at_port == 0 ? bind_to_any_port(options_.host) : bind_to_port(options_.host, at_port) ? at_port : -1;
  if (port_ < 0)
    throw std::runtime_error(fmt::format("cannot listen on {} port {}: {}", options_.host, at_port,
                                         errno != 0 ? std::strerror(errno) : "unknown host"));
  ::listen(svr_sock_, SOMAXCONN);  // the library's backlog is only 5
}

// Routes all paths to one handler: the api's table of routes also decides on 404, 405 and Allow.
void HttpServer::set_handlers() {
  set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& out) {
    Exchange& exchange = *exchange_of(request);
    if (request.method == "POST" && !exchange.refusal) return HandlerResponse::Unhandled;  // its body is read first
    answer(exchange, request, out);
    return HandlerResponse::Handled;
  });
  Post(R"([\s\S]*)",
       [this](const httplib::Request& request, httplib::Response& out, const httplib::ContentReader& read_body) {
         Exchange& exchange = *exchange_of(request);
         receive_body(exchange, read_body);
         answer(exchange, request, out);
       });
  set_exception_handler([this](const httplib::Request& request, httplib::Response& out, const std::exception_ptr&) {
    hand_over(*exchange_of(request), refuse({std::string(api::kOutOfMemory), "not enough memory for this request"}),
              out);
  });
  set_error_handler([this](const httplib::Request& request, httplib::Response& out) {
    Exchange* const exchange = exchange_of(request);
    if (exchange && exchange->answered) return;
    api::Response problem =
        refuse({"malformed_request", "not a well-formed HTTP/1.1 request whose head arrives whole and in time"});
    exchange ? hand_over(*exchange, std::move(problem), out) : write(std::move(problem), {}, out);
  });
  set_post_routing_handler([](const httplib::Request& request, httplib::Response& out) {
    const Exchange* const exchange = exchange_of(request);
    if (out.status == 304) out.headers.erase("Content-Length");  // 0 would contradict the representation's length
    out.headers.erase("Keep-Alive");                             // states a limit of requests that does not exist
    out.headers.erase("Connection");
    if (!exchange || exchange->close) out.set_header("Connection", "close");
  });
}

// Listens again after an error of accept(), which may concern a single client and must not end the service.
void HttpServer::run() {
  while (!listen_after_bind() && !stopping_) {
    spdlog::warn("accept() failed, listening again: {}", std::strerror(errno));
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    bind(port_);
  }
}

bool HttpServer::stop(Clock::time_point deadline) {
  stopping_ = true;
  ::shutdown(svr_sock_, SHUT_RDWR);  // accept() fails from now on, even if it has not been called yet
  std::unique_lock lock(mutex_);
  end_idle();
  if (changed_.wait_until(lock, deadline, [this] { return open_.empty(); })) return true;
  for (Connection* connection : open_) connection->cut();
  return false;
}

int HttpServer::connections() const {
  const std::lock_guard lock(mutex_);
  return static_cast<int>(open_.size());
}

// Serves the requests of a connection, one after the other, until it ends or the server stops.
bool HttpServer::process_and_close_socket(socket_t socket) {
  Connection connection(socket);
  const bool is_reserved = add(connection);
  const auto idle_time = is_reserved ? kReservedTime : options_.idle_time;
  try {
    while (!stopping_ && connection.wait_for_request(Clock::now() + idle_time) &&
           serve_request(connection, is_reserved)) {
    }
  } catch (const std::exception& e) {  // no memory for the exchange
    spdlog::warn("connection of {} ended: {}", connection.remote_address(), e.what());
  }
  const std::lock_guard lock(mutex_);
  open_.remove(&connection);
  changed_.notify_all();
  return true;  // the library ignores it
}

// Returns true if the connection is beyond the limit although idle ones were ended.
bool HttpServer::add(Connection& connection) {
  std::unique_lock lock(mutex_);
  open_.push_back(&connection);
  const auto is_beyond = [this] { return static_cast<int>(open_.size()) > options_.max_connections; };
  if (is_beyond() && end_idle() > 0) changed_.wait_for(lock, kReservedTime, [&] { return !is_beyond(); });
  return is_beyond();
}

// Ends the connections that wait for a request; under mutex_. Returns their number.
long HttpServer::end_idle() {
  return std::ranges::count_if(open_, [](Connection* connection) { return connection->end_idle(); });
}

void HttpServer::detect_disconnected_clients() {
  std::unique_lock lock(mutex_);
  while (!changed_.wait_for(lock, kDetectionInterval, [this] { return ending_; }))
    for (Connection* connection : open_) connection->detect_disconnect();
}

// Lets the library read, route and answer one request. Returns false when the connection ends with it.
bool HttpServer::serve_request(Connection& connection, bool is_reserved) {
  Exchange exchange(connection, is_reserved);
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
  AccessRecord& record = exchange.record;
  if (!exchange.answered) {                          // the library has refused the head
    if (connection.sent_bytes() == 0) return false;  // no request line
    record.error_code = "malformed_request";
    record.status = api::error_row(record.error_code).status;
    exchange.close = true;
  }
  record.bytes = std::min(record.bytes, connection.sent_bytes());
  record.seconds = seconds(Clock::now() - exchange.started);
  observer_(record);
  if (is_delivered && exchange.close) connection.linger();
  return is_delivered && !exchange.close && !is_last;
}

// Checks the parsed head, and removes the headers on which the library would act.
void HttpServer::take_head(Exchange& exchange, httplib::Request& request) const {
  request.response_handler = ExchangeCarrier{&exchange};
  AccessRecord& record = exchange.record;
  Headers& headers = exchange.request.headers = headers_of(request);
  record.method = exchange.request.method = request.method;
  if (!has_control(request.target)) record.target = request.target;
  record.path = record.target.substr(0, record.target.find('?'));  // answer() sets the decoded path
  record.request_id = request_id_of(headers);
  if (is_loopback(record.host) || std::ranges::count(options_.trusted_proxies, record.host) > 0)
    record.token = token_of(headers);
  exchange.refusal = refusal_of(exchange, request);
  // The body of a method other than POST is never read, and must not be taken for the next request.
  const bool has_body = headers.contains("transfer-encoding") || length_of(headers) > 0;
  exchange.close = exchange.refusal || (request.method != "POST" && has_body) || request.version == "HTTP/1.0" ||
                   dem::lower(request.get_header_value("Connection")) == "close";
  for (const char* name : kHiddenHeaders) request.headers.erase(name);
  request.ranges.clear();
  if (exchange.refusal) request.headers.erase("Expect");
  if (!has_body) request.set_header("Content-Length", "0");  // else the library reads until the end of the stream
  exchange.connection.limit_bytes(2 * options_.max_body_bytes + kMaxFramingBytes);
}

// Returns nothing if the head is accepted. Framing is the library's: see server/http/README.md.
std::optional<Refusal> HttpServer::refusal_of(const Exchange& exchange, const httplib::Request& request) const {
  const Headers& headers = exchange.request.headers;
  if (exchange.is_reserved && std::ranges::find(options_.reserved_paths, request.path) == options_.reserved_paths.end())
    return Refusal{"busy", "too many connections"};
  if (request.target.size() > kMaxTargetBytes)
    return Refusal{"uri_too_long", fmt::format("the request target has more than {} bytes", kMaxTargetBytes)};
  if (has_control(request.target)) return Refusal{"malformed_request", "the request target holds control characters"};
  if (headers.count("host") > 1 || (!headers.contains("host") && request.version != "HTTP/1.0"))
    return Refusal{"malformed_request", "exactly one Host header is needed"};
  if (headers.contains("content-encoding"))
    return Refusal{"unsupported_media_type", "bodies with a Content-Encoding are not taken"};
  if (length_of(headers) > options_.max_body_bytes)
    return Refusal{"too_large", fmt::format("the body has more than {} bytes", options_.max_body_bytes)};
  return hosts_.refusal(headers, exchange.connection.local_address());
}

// Receives the body within its limits of size and time.
void HttpServer::receive_body(Exchange& exchange, const httplib::ContentReader& read_body) const {
  std::string& body = exchange.request.body;
  const bool is_complete = read_body([&](const char* bytes, std::size_t size) {
    if (size > options_.max_body_bytes - body.size()) {
      exchange.refusal = Refusal{"too_large", fmt::format("the body has more than {} bytes", options_.max_body_bytes)};
      return false;
    }
    body.append(bytes, size);
    return true;
  });
  if (is_complete || exchange.refusal) return;
  exchange.refusal = exchange.connection.is_late() ? Refusal{"request_timeout", "the request did not arrive in time"}
                                                   : Refusal{"malformed_request", "the body could not be read"};
}

// Answers a request that is complete or refused.
void HttpServer::answer(Exchange& exchange, const httplib::Request& request, httplib::Response& out) const {
  exchange.started = Clock::now();
  if (exchange.refusal) {
    exchange.close = true;
    return hand_over(exchange, refuse(*exchange.refusal), out);
  }
  exchange.record.request_bytes = exchange.request.body.size();
  exchange.record.path = exchange.request.path = request.path;
  exchange.request.query = request.params;
  hand_over(exchange, work(exchange), out);
}

// Records the answer, and moves it into the library's response.
void HttpServer::hand_over(Exchange& exchange, api::Response&& answer, httplib::Response& out) const {
  AccessRecord& record = exchange.record;
  exchange.answered = true;
  exchange.close = exchange.close || stopping_ || exchange.is_reserved;
  exchange.answer_memory = std::move(answer.memory);
  exchange.connection.limit_time(options_.answer_time);
  record.status = answer.status;
  record.bytes = answer.body.size();  // serve_request() subtracts what the client does not take
  record.error_code = answer.error_code;
  record.stages = answer.stages;
  write(std::move(answer), record.request_id, out);
}

// Returns the problem document of a refusal.
api::Response HttpServer::refuse(const Refusal& why) const {
  const bool can_retry = api::error_row(why.error_code).status == 503;
  return can_retry ? api::retry_problem(why.error_code, why.detail, options_.retry_after_s())
                   : api::problem(why.error_code, why.detail);
}

// Runs the service's handler, and measures its times.
api::Response HttpServer::work(Exchange& exchange) const {
  AccessRecord& record = exchange.record;
  api::Request& request = exchange.request;
  request.received = Clock::now();
  request.abandoned = &exchange.connection.abandoned();
  request.peer = record.host;
  request.client = record.token.empty() ? record.host : "token " + record.token;
  exchange.connection.begin_work();
  api::Response response = handler_(request);
  exchange.connection.end_work();
  record.queued_s = seconds(response.queued);
  const double total_s = seconds(Clock::now() - request.received);
  record.work_s = total_s - record.queued_s;
  if (!response.stages.empty()) api::complete_timing(response.stages, 1e3 * total_s);
  request.body = {};  // while a slow client reads its answer, its request holds no memory
  return response;
}

std::string HttpServer::url() const {
  const bool is_ipv6 = options_.host.find(':') != std::string::npos;
  return fmt::format("http://{}:{}", is_ipv6 ? '[' + options_.host + ']' : options_.host, port_);
}

}  // namespace selenograph::server
