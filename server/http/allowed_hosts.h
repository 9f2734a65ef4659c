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

#include "server/http/caller.h"

namespace selenograph::server {

// Reason to refuse a request: the code of a row of the api's error table, and details.
struct Refusal {
  std::string error_code;
  std::string detail;
};

// Returns true for a host name or a numeric address (IPv6 with or without brackets), without scheme, port and path.
bool is_host(std::string_view text);

class AllowedHosts {
 public:
  // `listens_on`: --host. `allowed`: --allowed-host, each of which is_host().
  AllowedHosts(const std::string& listens_on, const std::vector<std::string>& allowed);

  // Returns nothing if the request is accepted. Names are compared without case and without a final dot, addresses by
  // value; ports of hosts are not compared, because a forwarded port differs and a rebound page has the right one.
  //  - "malformed_request": Host is not a host with an optional port;
  //  - "misdirected_request": it is none of localhost, 127.0.0.1, [::1], --host, --allowed-host and `local_address`,
  //    the server's numeric address of this connection. A request without Host passes: browsers always send it;
  //  - "foreign_origin": Origin is neither the request's own host and port nor, by http or https and on any port, a
  //    host of --allowed-host. "null" (a file, a sandboxed frame) is always foreign.
  std::optional<Refusal> refusal(const Headers& headers, std::string_view local_address) const;

 private:
  bool is_own_page(const std::string& origin, const std::string& own_host) const;

  std::set<std::string> served_;   // names and addresses accepted in Host
  std::set<std::string> allowed_;  // --allowed-host: also accepted in Origin
};

}  // namespace selenograph::server
