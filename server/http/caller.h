// Identifies requests: the client, the request id, and the name of the token that a proxy accepted.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace selenograph::server {

// The two ends of a connection, numeric and without port; empty: unknown.
struct Peer {
  std::string host;    // address of the client, or of its proxy
  std::string client;  // identity in the queue: `host`, or "token NAME" as named by a proxy
  std::string local;   // address to which the connection was made
};
Peer peer_of(int socket);

// Returns true for 1 to 64 letters, digits, '.', '_' and '-': safe in a header, in a log and in a file's name.
bool is_plain_name(std::string_view text);

// Headers by lower-case name.
using Headers = std::multimap<std::string, std::string>;

// Returns X-Request-Id if there is exactly one and it is_plain_name(), else a new id.
std::string request_id_of(const Headers& headers);
// Returns a new id, unique across calls and processes.
std::string new_request_id();

// Returns the name of a token from the header Selenograph-Token, which a trusted proxy sets; empty without the header,
// or if it is not is_plain_name(). Call it only for requests from a trusted proxy: any client can send the header.
std::string token_of(const Headers& headers);

// Classify numeric addresses; loopback is always a trusted proxy.
bool is_loopback(std::string_view address);
bool is_trusted_proxy(std::string_view address, const std::vector<std::string>& proxies);

}  // namespace selenograph::server
