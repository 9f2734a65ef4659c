// Access control by Host and Origin.
//
// A browser lets a page read the responses of its own origin. A page of evil.example has the service's origin once its
// owner resolves that name to the service's address (DNS rebinding), and then Host holds that name. So Host must be a
// name that the operator has given, or a numeric address, which no name server can redirect.
#pragma once

#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "server/http/request_head.h"

namespace selenograph::server {

// Returns true for a host name or a numeric address (IPv6 with or without brackets), without scheme, port and path.
bool is_host(std::string_view text);

class AllowedHosts {
 public:
  // `listens_on`: --host. `allowed`: --allowed-host, each of which is_host().
  AllowedHosts(const std::string& listens_on, const std::vector<std::string>& allowed);

  // Returns nothing if the request is accepted. Names are compared without case and without a final dot, addresses by
  // value; ports of hosts are not compared, because a forwarded port differs and a rebound page has the right one.
  //  - "malformed_request": the authority is not a host with an optional port;
  //  - "misdirected_request": its host is none of localhost, 127.0.0.1, [::1], --host, --allowed-host and
  //    `local_address`, the server's numeric address of this connection. HTTP/1.0 without Host passes: browsers do not
  //    send it, and health checks of proxies do;
  //  - "foreign_origin": Origin is neither the request's own host and port nor, by http or https and on any port, a
  //    host of --allowed-host. "null" (a file, a sandboxed frame) is always foreign.
  std::optional<Refusal> refusal(const RequestHead& head, std::string_view local_address) const;

 private:
  bool is_own_page(std::string_view origin, const RequestHead& head) const;

  std::set<std::string> served_;   // names and addresses accepted in Host
  std::set<std::string> allowed_;  // --allowed-host: also accepted in Origin
};

}  // namespace selenograph::server
