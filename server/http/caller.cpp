#include "server/http/caller.h"

#include <fmt/format.h>

#include <atomic>
#include <cstdint>
#include <random>

#include "dem/base/names.h"

namespace selenograph::server {
namespace {

// Returns the header's value if it is a plain name, which is safe in a header and in a log, and there is only one.
std::string plain_name(const Headers& headers, const std::string& header) {
  const auto found = headers.find(header);
  const bool is_plain =
      headers.count(header) == 1 && found->second.size() <= 64 && dem::consists_of(found->second, "._-");
  return is_plain ? found->second : std::string();
}

std::uint64_t random_number() {
  std::random_device source;
  return std::uint64_t{source()} << 32 | source();
}

}  // namespace

std::string request_id_of(const Headers& headers) {
  static const std::uint64_t process_id = random_number();
  static std::atomic<std::uint64_t> count{0};
  const std::string id = plain_name(headers, "x-request-id");
  return id.empty() ? fmt::format("{:016x}-{:x}", process_id, ++count) : id;
}

std::string token_of(const Headers& headers) { return plain_name(headers, "selenograph-token"); }

bool is_loopback(std::string_view address) { return address.starts_with("127.") || address == "::1"; }

}  // namespace selenograph::server
