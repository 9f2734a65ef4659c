// Content negotiation: the table of representations, and the Accept header (RFC 9110, 12.5.1).
#pragma once

#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/frame/products.h"

namespace selenograph::api {

enum class Format { npy, npz, png, tiff, exr, raw };

// A representation of a frame: a row of the table from which Accept selects.
struct Representation {
  Format format;
  std::string_view media_type;
  std::string_view extension;  // extension of a file
  bool holds_several;          // it can hold more than one product
  engine::ProductSet holds;    // products that it can hold
  std::string_view meaning;    // for the API document
};

// Returns all representations, in the server's order of preference when a client has none.
std::span<const Representation> representations();
const Representation& representation(Format format);

// A representation of an answer other than a frame.
struct Alternative {
  std::string_view media_type;
  std::string_view meaning;
};
// Representations of a round trip, in the order of the server's preference.
inline constexpr Alternative kRoundTripAnswers[] = {
    {"application/json", "the statistics"},
    {"image/tiff", "the differences as GeoTIFF: float32 metres, NaN where nothing was compared"},
};
// Returns the media type with the highest weight in `accept`, an Accept header; the first among equals. `can_hold`
// tells which media types can hold the answer; empty: all can. One that cannot is returned only if `accept` allows no
// other, and the caller then rejects the request. Throws RequestError("not_acceptable").
std::string_view choose_media_type(const std::string& accept, std::span<const Alternative> alternatives,
                                   const std::function<bool(std::string_view)>& can_hold = {});

// Returns true if `accept` allows a media type; an empty text allows all.
bool accepts(const std::string& accept, std::string_view media_type);

// Returns the representation for these products under `accept` (several Accept headers joined with commas; empty:
// anything). The highest q wins; among equals a lone `image` is a PNG, one product an .npy, several an .npz. Throws
// RequestError: "invalid_request" pointing at /products when no accepted representation can hold them, "not_acceptable"
// when no accepted representation exists.
const Representation& negotiate(const std::string& accept, engine::ProductSet products);

}  // namespace selenograph::api
