#include "api/message/message.h"

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <system_error>

namespace selenograph::api {

std::string header(const Request& request, const std::string& name) {
  std::string joined;
  const auto [first, last] = request.headers.equal_range(name);
  for (auto it = first; it != last; ++it) joined += (it == first ? "" : ", ") + it->second;
  return joined;
}

std::optional<std::chrono::milliseconds> time_limit(const Request& request, const Limits& limits) {
  const std::string text = header(request, "request-timeout-ms");
  if (text.empty()) return limits.default_deadline;
  std::int64_t ms = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), ms);
  if (error != std::errc() || end != text.data() + text.size() || ms <= 0) return std::nullopt;
  return std::min(limits.default_deadline, std::chrono::milliseconds(ms));
}

}  // namespace selenograph::api
