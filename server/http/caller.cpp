#include "server/http/caller.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <random>

#include "dem/files/names.h"

namespace selenograph::server {
namespace {

constexpr std::size_t kMostNameBytes = 64;
constexpr std::string_view kMapped = "::ffff:";  // of an IPv4 address that came to an IPv6 socket

std::string_view without_mapping(std::string_view address) {
  return address.starts_with(kMapped) && address.find('.') != std::string_view::npos ? address.substr(kMapped.size())
                                                                                     : address;
}

const std::string* only(const Headers& headers, const std::string& name) {
  return headers.count(name) == 1 ? &headers.find(name)->second : nullptr;
}

std::uint64_t random_number() {
  std::random_device source;
  return std::uint64_t{source()} << 32 | source();
}

}  // namespace

bool is_plain_name(std::string_view text) { return text.size() <= kMostNameBytes && dem::consists_of(text, "._-"); }

std::string request_id_of(const Headers& headers) {
  const std::string* given = only(headers, "x-request-id");
  return given && is_plain_name(*given) ? *given : new_request_id();
}

std::string new_request_id() {
  static const std::uint64_t of_process = random_number();
  static std::atomic<std::uint64_t> count{0};
  return fmt::format("{:016x}-{:x}", of_process, ++count);
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
