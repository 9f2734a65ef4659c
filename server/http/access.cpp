#include "server/http/access.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <random>

#include "api/message/problem.h"
#include "dem/base/names.h"

namespace selenograph::server {
namespace {

constexpr char kAdvice[] = "\"; its operator can add a host with --allowed-host";

// Returns the host of "host:port" or "host", equal for equal hosts: lower case, no brackets, no final dot.
std::string host_of(std::string_view authority) {
  const std::size_t colon = authority.rfind(':');
  const bool is_within_address = authority.find(':') != colon && authority[colon - 1] != ']';  // IPv6
  if (colon != std::string_view::npos && !is_within_address) authority = authority.substr(0, colon);
  if (authority.starts_with('[') && authority.ends_with(']')) authority = authority.substr(1, authority.size() - 2);
  if (authority.ends_with('.')) authority.remove_suffix(1);
  return dem::lower(authority);
}

}  // namespace

std::string plain_name(const Headers& headers, const std::string& header) {
  const auto found = headers.find(header);
  const bool is_plain =
      headers.count(header) == 1 && found->second.size() <= 64 && dem::consists_of(found->second, "._-");
  return is_plain ? found->second : std::string();
}

std::string new_request_id() {
  static std::random_device source;
  static const std::string process_id = fmt::format("{:08x}{:08x}", source(), source());
  static std::atomic<std::uint64_t> count{0};
  return fmt::format("{}-{:x}", process_id, ++count);
}

std::optional<api::Response> refusal_by_host(const Headers& headers, const std::vector<std::string>& own,
                                             const std::vector<std::string>& allowed) {
  const auto is_in = [](const std::vector<std::string>& hosts, const std::string& host) {
    return std::ranges::any_of(hosts, [&](const std::string& text) { return host_of(text) == host; });
  };
  std::string own_authority;
  for (auto [header, end] = headers.equal_range("host"); header != end; ++header) {
    own_authority = dem::lower(header->second);
    const std::string host = host_of(own_authority);
    if (!is_in(own, host) && !is_in(allowed, host))
      return api::problem("misdirected_request", "this service is not known as \"" + host + kAdvice);
  }
  for (auto [header, end] = headers.equal_range("origin"); header != end; ++header) {
    const std::string origin = dem::lower(header->second);
    // Another port of the same host is another origin, which its own program serves.
    if (origin == "http://" + own_authority || origin == "https://" + own_authority) continue;
    const std::size_t scheme = origin.starts_with("http://") ? 7 : origin.starts_with("https://") ? 8 : origin.size();
    if (is_in(allowed, host_of(std::string_view(origin).substr(scheme)))) continue;
    return api::problem("foreign_origin", "this service takes no requests of pages of \"" + header->second + kAdvice);
  }
  return std::nullopt;
}

}  // namespace selenograph::server
