#include "server/http/allowed_hosts.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <algorithm>
#include <array>
#include <charconv>

#include "dem/base/names.h"

namespace selenograph::server {
namespace {

constexpr std::size_t kMaxQuotedBytes = 100;  // of a client's text in an error

// Returns a numeric address in the system's notation, IPv4 in IPv6 as IPv4; empty if the text is not an address.
std::string canonical_address(const std::string& text) {
  in6_addr v6{};
  in_addr v4{};
  std::array<char, INET6_ADDRSTRLEN> out{};
  if (::inet_pton(AF_INET6, text.c_str(), &v6) == 1) {
    if (!IN6_IS_ADDR_V4MAPPED(&v6)) return ::inet_ntop(AF_INET6, &v6, out.data(), out.size());
    // The IPv4 address is the last four of the sixteen bytes: ::ffff:a.b.c.d.
    std::copy(std::begin(v6.s6_addr) + 12, std::end(v6.s6_addr), reinterpret_cast<unsigned char*>(&v4));
  } else if (::inet_pton(AF_INET, text.c_str(), &v4) != 1) {
    return {};
  }
  return ::inet_ntop(AF_INET, &v4, out.data(), out.size());
}

// Returns a text that is equal for equal hosts: lower case, no brackets, no final dot, canonical addresses.
std::string comparable(std::string_view host) {
  if (host.size() > 2 && host.front() == '[' && host.back() == ']') host = host.substr(1, host.size() - 2);
  if (host.size() > 1 && host.back() == '.') host.remove_suffix(1);
  const std::string text = dem::lower(host), address = canonical_address(text);
  return address.empty() ? text : address;
}

// Returns true for a name by RFC 3986 3.2.2 without percent-encoding, which no host's name needs.
bool is_name(std::string_view s) { return dem::consists_of(s, "-._~!$&'()*+,;="); }

bool is_bracketed_address(std::string_view s) {
  return s.size() > 2 && s.front() == '[' && s.back() == ']' &&
         !canonical_address(std::string(s.substr(1, s.size() - 2))).empty();
}

// Host and port of Host or of an origin.
struct Authority {
  std::string host;  // comparable()
  std::optional<int> port;
};

// Parses uri-host [":" port] (RFC 9110 7.2), of which the port may be empty. Returns nothing for other text.
std::optional<Authority> read_authority(std::string_view text) {
  // The port's colon is behind the bracket that ends an IPv6 address.
  const std::size_t bracket = text.rfind(']');
  const std::size_t colon = text.find(':', bracket == std::string_view::npos ? 0 : bracket);
  const std::string_view host = text.substr(0, colon);
  if (!is_name(host) && !is_bracketed_address(host)) return std::nullopt;
  Authority authority{comparable(host), std::nullopt};
  if (colon == std::string_view::npos || colon + 1 == text.size()) return authority;
  const char *const first = text.data() + colon + 1, *const last = text.data() + text.size();
  int port = 0;
  const auto [end, error] = std::from_chars(first, last, port);
  // from_chars() accepts a minus sign, also in "-0".
  if (error != std::errc() || end != last || port < 0 || port > 65535 || *first == '-') return std::nullopt;
  authority.port = port;
  return authority;
}

// Origin of a page, and the port that its scheme has without one.
struct Origin {
  Authority authority;
  int default_port;
};

// Parses an origin (RFC 6454 7). Returns nothing for "null", other schemes, and text that is not an origin.
std::optional<Origin> read_origin(std::string_view text) {
  for (const auto& [scheme, port] : {std::pair(std::string_view("http://"), 80), {"https://", 443}}) {
    if (!text.starts_with(scheme)) continue;
    if (auto authority = read_authority(text.substr(scheme.size()))) return Origin{std::move(*authority), port};
  }
  return std::nullopt;
}

std::string in_quotes(std::string_view text) { return '"' + std::string(text.substr(0, kMaxQuotedBytes)) + '"'; }

}  // namespace

bool is_host(std::string_view text) {
  return is_name(text) || is_bracketed_address(text) || !canonical_address(std::string(text)).empty();
}

AllowedHosts::AllowedHosts(const std::string& listens_on, const std::vector<std::string>& allowed)
    : served_{"localhost", "127.0.0.1", "::1", comparable(listens_on)} {
  for (const std::string& host : allowed) allowed_.insert(comparable(host));
  served_.insert(allowed_.begin(), allowed_.end());
}

std::optional<Refusal> AllowedHosts::refusal(const RequestHead& head, std::string_view local_address) const {
  if (head.authority) {
    const auto authority = read_authority(*head.authority);
    if (!authority) return Refusal{"malformed_request", "Host is not a name or address with an optional port"};
    if (!served_.contains(authority->host) && authority->host != comparable(local_address))
      return Refusal{"misdirected_request", "this service is not known as " + in_quotes(authority->host) +
                                                "; its operator can add a name with --allowed-host"};
  }
  const auto [first, last] = head.headers.equal_range("origin");
  // A request may have several Origin headers: each must be the service's own page, or allowed.
  const auto foreign = std::find_if(first, last, [&](const auto& h) { return !is_own_page(h.second, head); });
  if (foreign == last) return std::nullopt;
  return Refusal{"foreign_origin", "pages of the origin " + in_quotes(foreign->second) +
                                       " may not ask this service; its operator can allow a page's host with "
                                       "--allowed-host"};
}

// Compares ports as well: another port of the same host is another origin, which its own program serves.
bool AllowedHosts::is_own_page(std::string_view origin_text, const RequestHead& head) const {
  const auto origin = read_origin(origin_text);
  if (!origin) return false;
  if (allowed_.contains(origin->authority.host)) return true;
  const auto own = head.authority ? read_authority(*head.authority) : std::nullopt;
  return own && own->host == origin->authority.host &&
         own->port.value_or(origin->default_port) == origin->authority.port.value_or(origin->default_port);
}

}  // namespace selenograph::server
