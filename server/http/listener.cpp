#include "server/http/listener.h"

#include <arpa/inet.h>
#include <fcntl.h>
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
#include <set>
#include <stdexcept>
#include <string_view>
#include <system_error>
#include <utility>

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
  throw std::runtime_error("cannot listen on " + host + " port " + service + ": " + std::strerror(errno));
}

sockaddr_storage local_address_of(int fd) {
  sockaddr_storage address{};
  socklen_t size = sizeof(address);
  ::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size);
  return address;
}

// Copies an address of any family into the struct of its own: reading it in place through another type is undefined.
template <typename Address>
Address address_as(const sockaddr_storage& any) {
  static_assert(sizeof(Address) <= sizeof any);
  Address address;
  std::memcpy(&address, &any, sizeof address);
  return address;
}

int port_of(int fd) {
  const sockaddr_storage address = local_address_of(fd);
  return ntohs(address.ss_family == AF_INET6 ? address_as<sockaddr_in6>(address).sin6_port
                                             : address_as<sockaddr_in>(address).sin_port);
}

std::string host_of(const in_addr& from) {
  std::array<char, INET_ADDRSTRLEN> text{};
  ::inet_ntop(AF_INET, &from, text.data(), text.size());
  return text.data();
}

std::string host_of(const in6_addr& from) {
  std::array<char, INET6_ADDRSTRLEN> text{};
  ::inet_ntop(AF_INET6, &from, text.data(), text.size());
  return text.data();
}

std::string host_of(const sockaddr_storage& from) {
  if (from.ss_family == AF_INET) return host_of(address_as<sockaddr_in>(from).sin_addr);
  if (from.ss_family == AF_INET6) return host_of(address_as<sockaddr_in6>(from).sin6_addr);
  return {};
}

// What counts as one client: an IPv4 address, or the /64 network of an IPv6 address, of which a client may have all.
std::string client_of(const sockaddr_storage& from) {
  if (from.ss_family != AF_INET6) return host_of(from);
  in6_addr address = address_as<sockaddr_in6>(from).sin6_addr;
  const std::array<std::uint8_t, 12> v4_mapped{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff};
  if (std::memcmp(address.s6_addr, v4_mapped.data(), v4_mapped.size()) != 0) std::memset(address.s6_addr + 8, 0, 8);
  return host_of(address);
}

constexpr std::size_t kMostRefused = 64;
constexpr auto kRefusedStay = std::chrono::seconds(1);

}  // namespace

struct Listener::Client {
  Connection connection;
  bool done = false;  // under mutex_
  std::thread thread;
  Client(int fd, Peer peer, const SendPace& pace) : connection(fd, std::move(peer), pace) {}
  bool kept() const { return !done && !connection.given_up(); }
  bool reserved() const { return connection.peer().reserved; }
};

Listener::Listener(ListenerOptions options)
    : options_(std::move(options)),
      socket_(bind_host(options_.host, options_.port)),
      wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
      port_(port_of(socket_)) {}

Listener::~Listener() {
  if (socket_ >= 0) ::close(socket_);
  ::close(wake_);
  close_refused(Connection::Clock::time_point::max());
}

int Listener::extra_connections(int max_connections) { return std::max(8, max_connections / 8); }
int Listener::health_connections(int max_connections) { return std::max(8, max_connections / 16); }

// As many again may be about to end: see find_room().
int Listener::most_sockets(int max_connections) {
  return 2 * max_connections + extra_connections(max_connections) + health_connections(max_connections) +
         static_cast<int>(kMostRefused);
}

void Listener::run(const Serve& serve) {
  while (!stopping_) {
    std::array<pollfd, 2> waiting{pollfd{socket_, POLLIN, 0}, pollfd{wake_, POLLIN, 0}};
    const int at_most_ms = refused_.empty() ? -1 : 200;
    if (::poll(waiting.data(), waiting.size(), at_most_ms) < 0) continue;  // EINTR
    std::uint64_t wakes = 0;
    if (waiting[1].revents & POLLIN) [[maybe_unused]]
      const ssize_t got = ::read(wake_, &wakes, sizeof(wakes));
    if (!stopping_ && (waiting[0].revents & POLLIN)) accept_one(serve);
    close_refused(Connection::Clock::now() - kRefusedStay);
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

bool Listener::wait_until_done(Connection::Clock::time_point deadline) {
  std::unique_lock lock(mutex_);
  return closed_.wait_until(lock, deadline, [&] {
    return std::all_of(clients_.begin(), clients_.end(), [](const Client& client) { return client.done; });
  });
}

void Listener::cut() {
  const std::lock_guard lock(mutex_);
  for (Client& client : clients_) client.connection.cut();
}

void Listener::wake() {
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = ::write(wake_, &one, sizeof(one));
}

// Whatever accept() reports about one client (it left already, no descriptor is free) must never end the service, and
// neither must a lack of memory.
void Listener::accept_one(const Serve& serve) {
  sockaddr_storage from{};
  socklen_t size = sizeof(from);
  const int fd = ::accept4(socket_, reinterpret_cast<sockaddr*>(&from), &size, SOCK_CLOEXEC);
  if (fd < 0) {
    if (errno == EMFILE || errno == ENFILE || errno == ENOBUFS || errno == ENOMEM) {
      {
        const std::lock_guard lock(mutex_);
        give_up_oldest(Which::any, true) || give_up_oldest(Which::any, false);
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return;
  }
  const int on = 1;
  ::setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
  reap();
  Room room = Room::none;
  Peer peer;
  try {
    peer.host = host_of(from);
    peer.address = client_of(from);
    peer.local = host_of(local_address_of(fd));
    room = find_room(peer.address);
  } catch (const std::bad_alloc&) {  // refused, then
  }
  if (room == Room::none) return refuse(fd);
  peer.number = ++last_number_;
  peer.reserved = room == Room::health_only;
  start(fd, std::move(peer), serve);
}

void Listener::refuse(int fd) {
  const auto send = [&](std::string_view answer) {
    ::send(fd, answer.data(), answer.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  };
  try {
    send(options_.busy_answer());
  } catch (const std::bad_alloc&) {
    send(options_.spare_answer);
  }
  ::shutdown(fd, SHUT_WR);
  if (refused_.size() >= kMostRefused) close_refused(refused_.front().first + std::chrono::nanoseconds(1));
  try {
    refused_.emplace_back(Connection::Clock::now(), fd);
  } catch (const std::bad_alloc&) {
    ::close(fd);
  }
}

void Listener::close_refused(Connection::Clock::time_point before) {
  for (; !refused_.empty() && refused_.front().first < before; refused_.pop_front()) ::close(refused_.front().second);
}

void Listener::start(int fd, Peer peer, const Serve& serve) {
  const std::lock_guard lock(mutex_);
  bool listed = false;
  try {
    Client& client = clients_.emplace_back(fd, std::move(peer), options_.pace);
    listed = true;
    client.thread = std::thread([this, &client, &serve] {
      serve(client.connection);
      client.connection.cut();  // the client learns it now, the descriptor goes with reap()
      const std::lock_guard done(mutex_);
      client.done = true;
      closed_.notify_all();
      wake();
    });
  } catch (const std::exception&) {  // no thread or no memory to be had: this client goes, the service stays
    const int kept_fd = listed ? ::fcntl(fd, F_DUPFD_CLOEXEC, 0) : fd;
    if (listed) clients_.pop_back();
    if (kept_fd >= 0) refuse(kept_fd);
  }
}

int Listener::connections() const {
  const std::lock_guard lock(mutex_);
  return kept(false) + kept(true);
}

int Listener::kept(bool reserved) const {
  return static_cast<int>(std::count_if(clients_.begin(), clients_.end(), [&](const Client& client) {
    return client.kept() && client.reserved() == reserved;
  }));
}

// Threads of connections that were given up end at once, but a busy machine may need a moment for that: then newcomers
// wait in the backlog, so that there are never more than twice as many threads as connections.
Listener::Room Listener::find_room(const std::string& address) {
  std::unique_lock lock(mutex_);
  const Room room = room_for(address);
  if (room == Room::none) return room;
  const auto running = std::count_if(clients_.begin(), clients_.end(), [](const Client& c) { return !c.done; });
  if (running < 2 * options_.max_connections) return room;
  const bool ended = closed_.wait_for(lock, std::chrono::seconds(5), [&] {
    return std::count_if(clients_.begin(), clients_.end(), [](const Client& c) { return !c.done; }) <
           2 * options_.max_connections;
  });
  return ended ? room : Room::none;
}

Listener::Room Listener::room_for(const std::string& address) {
  const int most = options_.max_connections, regular = kept(false);
  if (regular < most || give_up_oldest(Which::silent, false) || give_up_slow_reader()) return Room::full;
  if (regular < most + extra_connections(most) && has_less_than_its_share(address)) return Room::full;
  if (kept(true) < health_connections(most) || give_up_oldest(Which::silent, true)) return Room::health_only;
  return give_up_oldest(Which::any, false) ? Room::full : Room::none;
}

bool Listener::has_less_than_its_share(const std::string& address) const {
  std::set<std::string_view> addresses{address};
  int of_address = 0;
  for (const Client& client : clients_) {
    if (!client.kept() || client.reserved()) continue;
    addresses.insert(client.connection.peer().address);
    of_address += client.connection.peer().address == address ? 1 : 0;
  }
  return of_address < options_.max_connections / static_cast<int>(addresses.size());
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

// Of those that wait for their client. False: there is none.
bool Listener::give_up_oldest(Which which, bool reserved) {
  const auto now = Connection::Clock::now();
  for (;;) {
    Connection* oldest = nullptr;
    for (Client& client : clients_) {
      if (client.done || !client.connection.waiting() || client.reserved() != reserved) continue;
      if (which == Which::silent && !client.connection.silent(now)) continue;
      if (!oldest || client.connection.since() < oldest->since()) oldest = &client.connection;
    }
    if (!oldest) return false;
    if (oldest->give_up()) return true;  // else it went to work a moment ago
  }
}

bool Listener::give_up_slow_reader() {
  const auto now = Connection::Clock::now();
  return std::any_of(clients_.begin(), clients_.end(),
                     [&](Client& client) { return client.connection.give_up_if_slow(now); });
}

}  // namespace selenograph::server
