#include "server/listener.h"

#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <system_error>
#include <utility>
#include <vector>

namespace selenograph::server {
namespace {

// SO_REUSEADDR only: with SO_REUSEPORT (httplib's default) a second service could quietly share the port with a first.
int listen_on(const addrinfo& address) {
  const int fd = ::socket(address.ai_family, address.ai_socktype | SOCK_CLOEXEC | SOCK_NONBLOCK, address.ai_protocol);
  if (fd < 0) return -1;
  const int on = 1;
  ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  if (::bind(fd, address.ai_addr, address.ai_addrlen) == 0 && ::listen(fd, SOMAXCONN) == 0) return fd;
  const int error = errno;
  ::close(fd);
  errno = error;
  return -1;
}

int bind_host(const std::string& host, int port) {
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE;
  addrinfo* found = nullptr;
  const std::string service = std::to_string(port);
  if (const int error = ::getaddrinfo(host.c_str(), service.c_str(), &hints, &found); error != 0) {
    throw std::runtime_error("host " + host + ": " + ::gai_strerror(error));
  }
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> guard(found, &::freeaddrinfo);
  for (const addrinfo* a = found; a; a = a->ai_next) {
    if (const int fd = listen_on(*a); fd >= 0) return fd;
  }
  throw std::runtime_error("can't listen on " + host + " port " + service + ": " + std::strerror(errno));
}

int port_of(int fd) {
  sockaddr_storage address{};
  socklen_t size = sizeof(address);
  ::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size);
  return address.ss_family == AF_INET6 ? ntohs(reinterpret_cast<sockaddr_in6&>(address).sin6_port)
                                       : ntohs(reinterpret_cast<sockaddr_in&>(address).sin_port);
}

}  // namespace

struct Listener::Client {
  Connection connection;
  bool done = false;  // under mutex_
  std::thread thread;
  explicit Client(int fd) : connection(fd) {}
};

Listener::Listener(const std::string& host, int port, int max_connections, std::string busy_answer)
    : socket_(bind_host(host, port)),
      wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
      port_(port_of(socket_)),
      max_connections_(max_connections),
      busy_answer_(std::move(busy_answer)) {}

Listener::~Listener() {
  if (socket_ >= 0) ::close(socket_);
  ::close(wake_);
}

void Listener::run(const Serve& serve) {
  while (!stopping_) {
    std::array<pollfd, 2> waiting{pollfd{socket_, POLLIN, 0}, pollfd{wake_, POLLIN, 0}};
    if (::poll(waiting.data(), waiting.size(), -1) < 0) continue;  // EINTR
    std::uint64_t wakes = 0;
    if (waiting[1].revents & POLLIN) [[maybe_unused]]
      const ssize_t got = ::read(wake_, &wakes, sizeof(wakes));
    if (!stopping_ && (waiting[0].revents & POLLIN)) accept_one(serve);
    reap();
  }
  ::close(std::exchange(socket_, -1));
  std::unique_lock lock(mutex_);
  for (Client& client : clients_) client.connection.give_up();
  while (!clients_.empty()) {
    closed_.wait(lock, [&] { return clients_.front().done; });
    clients_.front().thread.join();
    clients_.pop_front();
  }
}

void Listener::stop() {
  stopping_ = true;
  wake();
  const std::lock_guard lock(mutex_);
  for (Client& client : clients_) client.connection.give_up();
}

void Listener::wake() {
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = ::write(wake_, &one, sizeof(one));
}

// Whatever accept() reports about one client (it left already, no descriptor is free) must never end the service.
void Listener::accept_one(const Serve& serve) {
  const int fd = ::accept4(socket_, nullptr, nullptr, SOCK_CLOEXEC);
  if (fd < 0) {
    if (errno == EMFILE || errno == ENFILE || errno == ENOBUFS || errno == ENOMEM) {
      const std::lock_guard lock(mutex_);
      give_up_oldest();
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return;
  }
  const int on = 1;
  ::setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
  reap();
  if (find_room()) return start(fd, serve);
  ::send(fd, busy_answer_.data(), busy_answer_.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  ::close(fd);
}

void Listener::start(int fd, const Serve& serve) {
  const std::lock_guard lock(mutex_);
  Client& client = clients_.emplace_back(fd);
  try {
    client.thread = std::thread([this, &client, &serve] {
      serve(client.connection);
      ::shutdown(client.connection.fd(), SHUT_RDWR);  // the client learns it now, the descriptor goes with reap()
      const std::lock_guard done(mutex_);
      client.done = true;
      closed_.notify_all();
      wake();
    });
  } catch (const std::system_error&) {  // no thread to be had: this client goes, the service stays
    clients_.pop_back();
  }
}

int Listener::connections() const {
  const std::lock_guard lock(mutex_);
  return kept();
}

int Listener::kept() const {
  return static_cast<int>(std::count_if(clients_.begin(), clients_.end(), [](const Client& client) {
    return !client.done && !client.connection.given_up();
  }));
}

// Threads of connections that were given up end at once, but a busy machine may need a moment for that: then newcomers
// wait in the backlog, so that there are never more than twice as many threads as connections.
bool Listener::find_room() {
  std::unique_lock lock(mutex_);
  if (kept() >= max_connections_ && !give_up_oldest()) return false;
  const auto running = [&] {
    return std::count_if(clients_.begin(), clients_.end(), [](const Client& c) { return !c.done; });
  };
  return closed_.wait_for(lock, std::chrono::seconds(5), [&] { return running() < 2 * max_connections_; });
}

void Listener::reap() {
  const std::lock_guard lock(mutex_);
  for (auto client = clients_.begin(); client != clients_.end();) {
    if (!client->done) {
      ++client;
      continue;
    }
    client->thread.join();
    client = clients_.erase(client);
  }
}

// Of those that wait for their client. False: all are at work.
bool Listener::give_up_oldest() {
  std::vector<std::pair<Connection::Clock::time_point, Connection*>> by_age;  // times may change while we look
  for (Client& client : clients_) by_age.emplace_back(client.connection.waiting_since(), &client.connection);
  std::sort(by_age.begin(), by_age.end());
  return std::any_of(by_age.begin(), by_age.end(), [](const auto& entry) { return entry.second->give_up(); });
}

}  // namespace selenograph::server
