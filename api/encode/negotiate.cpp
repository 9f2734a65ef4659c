#include "api/encode/negotiate.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <optional>
#include <utility>

#include "api/message/problem.h"
#include "dem/base/names.h"

namespace selenograph::api {
namespace {

constexpr engine::ProductSet kAllProducts = ~engine::ProductSet{0};

constexpr std::array<Representation, 6> kRepresentations{{
    {Format::npy, "application/x-npy", "npy", false, kAllProducts, "one product as a NumPy .npy array"},
    {Format::npz, "application/x-npz", "npz", true, kAllProducts,
     "all products as one NumPy .npz, with meta.json inside"},
    {Format::png, "image/png", "png", false, engine::kImage, "`image`, 8 or 16 bit grey"},
    {Format::tiff, "image/tiff", "tiff", false, kAllProducts, "one product, float or integer"},
    {Format::exr, "image/x-exr", "exr", true, kAllProducts, "all products as named channels"},
    {Format::raw, "application/octet-stream", "raw", false, kAllProducts,
     "one product, raw little-endian, row by row; shape and type in headers"},
}};

// One element of an Accept header, such as "image/*;q=0.5". Parameters other than q are ignored: no representation has
// any.
struct MediaRange {
  std::string_view type, subtype;
  double q = 1;  // weight, 0 (not acceptable) to 1
  // Returns 0 for "*/*", 1 for "image/*", 2 for "image/png".
  int specificity() const { return (type != "*") + (subtype != "*"); }
  bool matches(std::string_view media_type) const {
    const std::size_t slash = media_type.find('/');
    return (type == "*" || type == media_type.substr(0, slash)) &&
           (subtype == "*" || subtype == media_type.substr(slash + 1));
  }
};

// Returns the text without blanks at its ends.
std::string_view trimmed(std::string_view s) {
  const std::size_t first = s.find_first_not_of(" \t");
  return first == std::string_view::npos ? "" : s.substr(first, s.find_last_not_of(" \t") - first + 1);
}

// Returns the trimmed parts of a text between its separators; at least one.
std::vector<std::string_view> split(std::string_view rest, char separator) {
  std::vector<std::string_view> parts;
  while (true) {
    const std::size_t part_size = rest.find(separator);
    parts.push_back(trimmed(rest.substr(0, part_size)));
    if (part_size == std::string_view::npos) return parts;
    rest.remove_prefix(part_size + 1);
  }
}

// Returns a weight from 0 to 1; 0 for an invalid one, so that a range with it is never chosen.
double weight(std::string_view text) {
  double q = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), q);
  return error == std::errc() && end == text.data() + text.size() && q >= 0 && q <= 1 ? q : 0;
}

// Parses an element of an Accept header; empty for one without a slash, which is ignored.
std::optional<MediaRange> read_media_range(std::string_view element) {
  const std::vector<std::string_view> parts = split(element, ';');
  const std::size_t slash = parts[0].find('/');
  if (slash == std::string_view::npos) return std::nullopt;
  MediaRange range{trimmed(parts[0].substr(0, slash)), trimmed(parts[0].substr(slash + 1))};
  for (const std::string_view parameter : std::span(parts).subspan(1)) {
    if (parameter.starts_with("q=")) range.q = weight(parameter.substr(2));
  }
  return range;
}

// A parsed Accept header. It owns the text, in lower case, to which its ranges point.
class Accept {
 public:
  explicit Accept(const std::string& header) : text_(dem::lower(header)) {
    if (trimmed(text_).empty()) text_ = "*/*";
    for (const std::string_view element : split(text_, ',')) {
      if (const auto range = read_media_range(element)) ranges_.push_back(*range);
    }
  }
  Accept(const Accept&) = delete;
  Accept& operator=(const Accept&) = delete;

  // Returns the weight of the most specific range that matches; 0 if none does.
  double q(std::string_view media_type) const {
    const MediaRange* best = nullptr;
    for (const MediaRange& range : ranges_) {
      if (range.matches(media_type) && (!best || range.specificity() > best->specificity())) best = &range;
    }
    return best ? best->q : 0;
  }

 private:
  std::string text_;
  std::vector<MediaRange> ranges_;
};

// Returns true if one answer in this representation can hold all of the products.
bool can_hold(const Representation& r, engine::ProductSet products) {
  return (products & ~r.holds) == 0 && (r.holds_several || std::has_single_bit(products));
}

// Returns true for the representation that is chosen among equal weights.
bool is_default_for(const Representation& r, engine::ProductSet products) {
  if (products == engine::kImage) return r.format == Format::png;
  return r.format == (std::has_single_bit(products) ? Format::npy : Format::npz);
}

// Returns the media types of these representations: "application/x-npz, image/x-exr".
std::string list_of(bool (*is_listed)(const Representation&)) {
  std::string media_types;
  for (const Representation& r : kRepresentations) {
    if (is_listed(r)) media_types += (media_types.empty() ? "" : ", ") + std::string(r.media_type);
  }
  return media_types;
}

// Throws the error for no representation: `unable` is accepted but cannot hold the products, or null if none is
// accepted.
[[noreturn]] void reject(const Representation* unable) {
  if (!unable) {
    throw RequestError("not_acceptable", "there is " + list_of([](const Representation&) { return true; }) +
                                             "; Accept allows none of them");
  }
  const std::string what = unable->format == Format::png
                               ? std::string(unable->media_type) + " holds the product \"image\" alone"
                               : std::string(unable->media_type) + " holds exactly one product";
  const std::string several = list_of([](const Representation& r) { return r.holds_several; });
  throw RequestError("invalid_request", what, {{"/products", what + "; several are held by " + several}});
}

}  // namespace

std::span<const Representation> representations() { return kRepresentations; }

const Representation& representation(Format format) {
  return *std::find_if(kRepresentations.begin(), kRepresentations.end(),
                       [&](const Representation& r) { return r.format == format; });
}

bool accepts(const std::string& accept, std::string_view media_type) { return Accept(accept).q(media_type) > 0; }

std::string_view choose_media_type(const std::string& accept, std::span<const Alternative> alternatives,
                                   const std::function<bool(std::string_view)>& can_hold) {
  const Accept allowed(accept);
  // Ranks compare member by member: a media type that can hold the answer precedes all that cannot, and only then does
  // the client's weight decide.
  struct Rank {
    bool can_hold_answer = false;
    double weight = 0;
    auto operator<=>(const Rank&) const = default;
  };
  const Alternative* best = nullptr;
  Rank best_rank;  // the lowest rank, that of a media type which Accept does not allow: none of those is chosen
  std::string media_types;
  for (const Alternative& alternative : alternatives) {
    media_types += (media_types.empty() ? "" : ", ") + std::string(alternative.media_type);
    const double q = allowed.q(alternative.media_type);
    const Rank rank{q > 0 && (!can_hold || can_hold(alternative.media_type)), q};
    if (rank > best_rank) {
      best = &alternative;
      best_rank = rank;
    }
  }
  if (!best) throw RequestError("not_acceptable", "there is " + media_types + "; Accept allows none of them");
  return best->media_type;
}

const Representation& negotiate(const std::string& accept, engine::ProductSet products) {
  const Accept allowed(accept);
  const Representation* best = nullptr;
  const Representation* unable = nullptr;  // accepted, but cannot hold these products
  double best_q = 0;
  for (const Representation& r : kRepresentations) {
    const double q = allowed.q(r.media_type);
    if (q <= 0) continue;
    if (!can_hold(r, products)) {
      if (!unable) unable = &r;
    } else if (q > best_q || (q == best_q && is_default_for(r, products))) {
      best = &r;
      best_q = q;
    }
  }
  if (!best) reject(unable);
  return *best;
}

}  // namespace selenograph::api
