#include "server/campaign/plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <numeric>
#include <stdexcept>

#include "dem/base/parallel.h"
#include "server/campaign/sha256.h"

namespace selenograph::server {
namespace {

// All lines in the order of the terrain, and the cost of each (weight_of()).
struct OrderedLines {
  std::vector<const ManifestLine*> lines;
  std::vector<std::uint64_t> weights;
};

OrderedLines order_lines(const Manifest& manifest) {
  const std::vector<ManifestLine>& lines = manifest.lines();
  std::vector<std::uint64_t> keys(lines.size()), weights(lines.size());
  in_parallel(lines.size(), [&](std::size_t i) {
    const api::Json request = lines[i].problem ? api::Json() : manifest.request(lines[i]);
    keys[i] = terrain_key(request);
    weights[i] = lines[i].problem ? 1 : weight_of(request);
  });
  std::vector<std::size_t> order(lines.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return keys[a] < keys[b]; });
  OrderedLines ordered;
  for (const std::size_t i : order) {
    ordered.lines.push_back(&lines[i]);
    ordered.weights.push_back(weights[i]);
  }
  return ordered;
}

}  // namespace

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

std::string TarPlan::sha256() const {
  Sha256 digest;
  for (const ManifestLine* line : lines) digest.add(line->name + " " + line->request_sha256 + "\n");
  return digest.hex();
}

std::vector<const ManifestLine*> lines_of(const Manifest& manifest, const Shard& shard) {
  const OrderedLines order = order_lines(manifest);
  const Span span = cut_evenly(order.weights, shard.of)[shard.index];
  return {order.lines.begin() + static_cast<std::ptrdiff_t>(span.begin),
          order.lines.begin() + static_cast<std::ptrdiff_t>(span.end)};
}

std::vector<TarPlan> tars_of(const Manifest& manifest, const Shard& shard, std::size_t lines_per_tar) {
  const OrderedLines order = order_lines(manifest);
  std::vector<TarPlan> tars;
  std::vector<std::uint64_t> weights;
  for (std::size_t begin = 0; begin < order.lines.size(); begin += lines_per_tar) {
    const std::size_t end = std::min(begin + lines_per_tar, order.lines.size());
    tars.push_back({fmt::format("frames-{:06}.tar", tars.size()),
                    {order.lines.begin() + static_cast<std::ptrdiff_t>(begin),
                     order.lines.begin() + static_cast<std::ptrdiff_t>(end)}});
    weights.push_back(std::accumulate(order.weights.begin() + static_cast<std::ptrdiff_t>(begin),
                                      order.weights.begin() + static_cast<std::ptrdiff_t>(end), std::uint64_t{0}));
  }
  const Span span = cut_evenly(weights, shard.of)[shard.index];
  return {tars.begin() + static_cast<std::ptrdiff_t>(span.begin), tars.begin() + static_cast<std::ptrdiff_t>(span.end)};
}

}  // namespace selenograph::server
