// A body in chunks: however it is cut into pieces, the same comes out, and what is accepted is what a decoder reads
// that was written down from RFC 9112, 7.1, without a thought of pieces or bounds. The first byte says how large pieces
// are.
#include <algorithm>
#include <cctype>
#include <optional>
#include <string>
#include <string_view>

#include "server/http/chunked_body.h"
#include "tests/fuzz/fuzz.h"

namespace selenograph::fuzz {
namespace {

using server::ChunkedBody;

constexpr std::size_t kMaxBody = 600;

struct Decoded {
  ChunkedBody::State state = ChunkedBody::State::more;
  std::string body, rest;
  bool operator==(const Decoded&) const = default;
};

Decoded decoded(std::string_view raw, std::size_t piece) {
  ChunkedBody chunks(kMaxBody);
  Decoded out;
  for (; !raw.empty(); raw.remove_prefix(std::min(piece, raw.size()))) {
    std::string_view part = raw.substr(0, piece);
    const std::size_t came = part.size();
    out.state = chunks.take(part, out.body);
    require(part.size() <= came, "no more is taken than there is");
    require(out.state != ChunkedBody::State::more || part.empty(), "all is taken until the end");
    require(out.body.size() <= kMaxBody, "the body is bounded");
    out.rest += part;
  }
  return out;
}

// The plain reference: body and number of bytes that it takes; empty when it is not whole or not well formed. Trailers
// and extensions are only looked at as far as the end of their line needs it.
struct Plain {
  std::string body;
  std::size_t bytes;
};

std::optional<Plain> plain(std::string_view raw) {
  Plain out{{}, 0};
  const auto line = [&]() -> std::optional<std::string_view> {
    const std::size_t end = raw.find("\r\n", out.bytes);
    if (end == std::string_view::npos) return {};
    const std::string_view text = raw.substr(out.bytes, end - out.bytes);
    out.bytes = end + 2;
    return text.find_first_of("\r\n") == std::string_view::npos ? std::optional(text) : std::nullopt;
  };
  for (;;) {
    const auto head = line();
    if (!head) return {};
    std::size_t size = 0, digits = 0;
    for (; digits < head->size() && std::isxdigit(static_cast<unsigned char>((*head)[digits])); ++digits)
      size = std::min<std::size_t>(16 * size + std::stoul(std::string(1, (*head)[digits]), nullptr, 16), 1 << 20);
    if (digits == 0 ||
        (digits < head->size() && std::string_view("; \t").find((*head)[digits]) == std::string_view::npos))
      return {};
    if (size == 0) break;
    if (size > raw.size() - out.bytes) return {};
    out.body += raw.substr(out.bytes, size);
    out.bytes += size;
    const auto end = line();
    if (!end || !end->empty()) return {};
  }
  for (;;) {
    const auto trailer = line();
    if (!trailer) return {};
    if (trailer->empty()) return out;
  }
}

}  // namespace
}  // namespace selenograph::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace selenograph;
  if (size == 0) return 0;
  const std::string_view raw = fuzz::text_of(data + 1, size - 1);
  const fuzz::Decoded whole = fuzz::decoded(raw, std::max<std::size_t>(raw.size(), 1));
  fuzz::require(whole == fuzz::decoded(raw, 1), "byte by byte as in one piece");
  fuzz::require(whole == fuzz::decoded(raw, 1 + data[0]), "in pieces as in one");
  if (whole.state != server::ChunkedBody::State::complete) return 0;
  const auto plain = fuzz::plain(raw);
  fuzz::require(plain.has_value(), "what is accepted is well formed");
  fuzz::require(plain->body == whole.body, "the body is the reference's");
  fuzz::require(raw.substr(plain->bytes) == whole.rest, "it ends where the reference ends");
  return 0;
}
