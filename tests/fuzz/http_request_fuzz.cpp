// All that a client may send on one connection, to a real service on loopback: each answer is one, and bodies are
// bounded.
#include <cstdlib>
#include <memory>
#include <string>
#include <thread>

#include "server/http/http_server.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/raw_client.h"

namespace selenograph::fuzz {
namespace {

constexpr std::size_t kMaxBodyBytes = 1000;

api::Response answer(const api::Request& request) {
  require(request.body.size() <= kMaxBodyBytes, "bodies are bounded");
  api::Response response;
  response.content_type = "text/plain";
  response.body = "answer";
  return response;
}

// Runs until the process ends: libFuzzer has no hook for its end.
const server::HttpServer& service() {
  static server::HttpServer* const running = [] {
    server::HttpServer* const made = server::HttpServer::make({.host = "127.0.0.1",
                                                               .port = 0,
                                                               .max_connections = 64,
                                                               .max_body_bytes = kMaxBodyBytes,
                                                               .idle_time = std::chrono::seconds(5),
                                                               .receive_time = std::chrono::seconds(5),
                                                               .answer_time = std::chrono::seconds(5)},
                                                              answer, [](const server::AccessRecord&) {})
                                         .release();
    std::thread([made] { made->run(); }).detach();
    return made;
  }();
  return *running;
}

}  // namespace
}  // namespace selenograph::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace selenograph;
  const test::RawClient client(fuzz::service().port());
  fuzz::require(client.is_connected(), "the service accepts");
  client.send(fuzz::text_of(data, size));
  client.end();
  const std::string received = client.receive();
  fuzz::require(received.empty() || received.starts_with("HTTP/1.1 "), "an answer begins with its status", received);
  return 0;
}
