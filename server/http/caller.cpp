#include "server/http/caller.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <random>

#include "dem/base/names.h"

namespace selenograph::server {
namespace {

constexpr std::size_t kMaxNameBytes = 64;
constexpr std::string_view kMapped = "::ffff:";  // prefix of an IPv4 client of an IPv6 socket

std::string_view without_mapping(std::string_view address) {
  return address.starts_with(kMapped) && address.find('.') != std::string_view::npos ? address.substr(kMapped.size())
                                                                                     : address;
}

// Returns the header's value, and null unless there is exactly one.
const std::string* only(const Headers& headers, const std::string& name) {
  return headers.count(name) == 1 ? &headers.find(name)->second : nullptr;
}

// Copies an address into the struct of its family: reading it in place through another type is undefined behaviour.
template <typename Address>
Address address_as(const sockaddr_storage& any) {
  static_assert(sizeof(Address) <= sizeof any);
  Address address;
  std::memcpy(&address, &any, sizeof address);
  return address;
}

template <typename Address>
std::string numeric(int family, const Address& address) {
  std::array<char, INET6_ADDRSTRLEN> text{};
  ::inet_ntop(family, &address, text.data(), text.size());
  return text.data();
}

// Returns the numeric address of an end of a connection; empty for another family than IPv4 and IPv6.
std::string host_of(const sockaddr_storage& end) {
  if (end.ss_family == AF_INET) return numeric(AF_INET, address_as<sockaddr_in>(end).sin_addr);
  if (end.ss_family == AF_INET6) return numeric(AF_INET6, address_as<sockaddr_in6>(end).sin6_addr);
  return {};
}

std::uint64_t random_number() {
  std::random_device source;
  return std::uint64_t{source()} << 32 | source();
}

}  // namespace

Peer peer_of(int socket) {
  sockaddr_storage remote{};
  sockaddr_storage local{};
  socklen_t remote_size = sizeof remote;
  socklen_t local_size = sizeof local;
  ::getpeername(socket, reinterpret_cast<sockaddr*>(&remote), &remote_size);
  ::getsockname(socket, reinterpret_cast<sockaddr*>(&local), &local_size);
  return {host_of(remote), host_of(remote), host_of(local)};
}

bool is_plain_name(std::string_view text) { return text.size() <= kMaxNameBytes && dem::consists_of(text, "._-"); }

std::string request_id_of(const Headers& headers) {
  const std::string* id = only(headers, "x-request-id");
  return id && is_plain_name(*id) ? *id : new_request_id();
}

std::string new_request_id() {
  static const std::uint64_t process_id = random_number();
  static std::atomic<std::uint64_t> count{0};
  return fmt::format("{:016x}-{:x}", process_id, ++count);
}

std::string token_of(const Headers& headers) {
  const std::string* name = only(headers, "selenograph-token");
  return name && is_plain_name(*name) ? *name : std::string();
}

bool is_loopback(std::string_view address) { return without_mapping(address).starts_with("127.") || address == "::1"; }

bool is_trusted_proxy(std::string_view address, const std::vector<std::string>& proxies) {
  return is_loopback(address) || std::any_of(proxies.begin(), proxies.end(), [&](const std::string& proxy) {
           return without_mapping(proxy) == without_mapping(address);
         });
}

}  // namespace selenograph::server
