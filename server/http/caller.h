// What a request says about itself: its id, and by whose token a proxy let it in.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace selenograph::server {

// 1 to 64 letters, digits, '.', '_' and '-': safe in a header, in a log and in a file's name.
bool is_plain_name(std::string_view text);

// By lower-case name.
using Headers = std::multimap<std::string, std::string>;

// X-Request-Id if there is exactly one and it is_plain_name(), else a new id.
std::string request_id_of(const Headers& headers);
// Different in every call and every process.
std::string new_request_id();

// The name of a token, from the header Selenograph-Token, that a proxy sets: empty without a header, or when it is not
// is_plain_name(). Only what comes from such a proxy is asked.
std::string token_of(const Headers& headers);

// Numeric addresses: those of proxies, and loopback.
bool is_loopback(std::string_view address);
bool is_trusted_proxy(std::string_view address, const std::vector<std::string>& proxies);

}  // namespace selenograph::server
