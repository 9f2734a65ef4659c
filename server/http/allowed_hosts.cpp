#include "server/http/allowed_hosts.h"

#include <arpa/inet.h>

#include <array>
#include <regex>

#include "dem/base/names.h"

namespace selenograph::server {
namespace {

constexpr std::size_t kMaxHostBytes = 300;  // of names 253; bounds the recursion of std::regex

// Returns a numeric address in the system's notation; empty if the text is not an address.
std::string canonical_address(const std::string& text) {
  std::array<unsigned char, sizeof(in6_addr)> bytes{};
  std::array<char, INET6_ADDRSTRLEN> out{};
  for (const int family : {AF_INET, AF_INET6}) {
    if (::inet_pton(family, text.c_str(), bytes.data()) == 1)
      return ::inet_ntop(family, bytes.data(), out.data(), out.size());
  }
  return {};
}

// Returns a text that is equal for equal hosts: lower case, no brackets, no final dot, canonical addresses.
std::string comparable(std::string_view host) {
  if (host.size() > 2 && host.front() == '[' && host.back() == ']') host = host.substr(1, host.size() - 2);
  if (host.size() > 1 && host.back() == '.') host.remove_suffix(1);
  const std::string text = dem::lower(host);
  const std::string address = canonical_address(text);
  return address.empty() ? text : address;
}

struct Authority {
  std::string host;  // comparable()
  int port = 0;
};

// Parses uri-host [":" port] (RFC 9110 7.2; names without percent-encoding). Returns nothing for other text.
std::optional<Authority> read_authority(std::string_view text, int default_port) {
  static const std::regex kAuthority(R"((\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._~!$&'()*+,;=-]+)(:\d{0,5})?)");
  std::match_results<std::string_view::const_iterator> match;
  if (text.size() > kMaxHostBytes || !std::regex_match(text.begin(), text.end(), match, kAuthority)) return {};
  const std::string host = match.str(1);
  const std::string port = match.str(2);
  if (host.front() == '[' && canonical_address(host.substr(1, host.size() - 2)).empty()) return {};
  Authority authority{comparable(host), port.size() > 1 ? std::stoi(port.substr(1)) : default_port};
  if (authority.port > 65535) return {};
  return authority;
}

std::string in_quotes(std::string_view text) { return '"' + std::string(text.substr(0, 100)) + '"'; }

}  // namespace

bool is_host(std::string_view text) {
  const bool has_port = !text.ends_with(']') && text.find(':') != std::string_view::npos;
  return !canonical_address(std::string(text)).empty() || (!has_port && read_authority(text, 0));
}

AllowedHosts::AllowedHosts(const std::string& listens_on, const std::vector<std::string>& allowed)
    : served_{"localhost", "127.0.0.1", "::1", comparable(listens_on)} {
  for (const std::string& host : allowed) allowed_.insert(comparable(host));
  served_.insert(allowed_.begin(), allowed_.end());
}

std::optional<Refusal> AllowedHosts::refusal(const Headers& headers, std::string_view local_address) const {
  const auto host = headers.find("host");
  if (host != headers.end()) {
    const auto authority = read_authority(host->second, 0);
    if (!authority) return Refusal{"malformed_request", "Host is not a name or address with an optional port"};
    if (!served_.contains(authority->host) && authority->host != comparable(local_address))
      return Refusal{"misdirected_request", "this service is not known as " + in_quotes(authority->host) +
                                                "; its operator can add a name with --allowed-host"};
  }
  const std::string own_host = host == headers.end() ? std::string() : host->second;
  // A request may have several Origin headers: each must be the service's own page, or allowed.
  for (auto [origin, end] = headers.equal_range("origin"); origin != end; ++origin) {
    if (is_own_page(origin->second, own_host)) continue;
    return Refusal{"foreign_origin", "pages of the origin " + in_quotes(origin->second) +
                                         " may not ask this service; its operator can allow a page's host with "
                                         "--allowed-host"};
  }
  return std::nullopt;
}

// Compares ports as well: another port of the same host is another origin, which its own program serves.
bool AllowedHosts::is_own_page(const std::string& origin, const std::string& own_host) const {
  for (const auto& [scheme, port] : {std::pair(std::string_view("http://"), 80), {"https://", 443}}) {
    if (!origin.starts_with(scheme)) continue;
    const auto page = read_authority(std::string_view(origin).substr(scheme.size()), port);
    const auto own = read_authority(own_host, port);
    return page && (allowed_.contains(page->host) || (own && own->host == page->host && own->port == page->port));
  }
  return false;
}

}  // namespace selenograph::server
