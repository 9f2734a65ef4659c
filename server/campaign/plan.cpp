#include "server/campaign/plan.h"

#include <fmt/format.h>

#include <charconv>
#include <stdexcept>
#include <system_error>

namespace selenograph::server {

Shard shard_of(const std::string& text) {
  Shard shard;
  const char* const end = text.data() + text.size();
  const auto index = std::from_chars(text.data(), end, shard.index);
  const bool slash = index.ec == std::errc() && index.ptr != end && *index.ptr == '/';
  const auto of = slash ? std::from_chars(index.ptr + 1, end, shard.of) : std::from_chars_result{};
  constexpr std::size_t kMaxShards = 100000;
  if (!slash || of.ec != std::errc() || of.ptr != end || shard.of > kMaxShards || shard.index >= shard.of)
    throw std::runtime_error(
        fmt::format("--shard: \"{}\" is not I/N with I from 0 to N - 1 and N up to {}, like 0/16", text, kMaxShards));
  return shard;
}

Span span_of(std::size_t count, const Shard& shard) {
  return {count * shard.index / shard.of, count * (shard.index + 1) / shard.of};
}

}  // namespace selenograph::server
