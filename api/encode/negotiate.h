// Which representation answers a request: the table of what there is, and the Accept header (RFC 9110, 12.5.1).
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/frame/products.h"

namespace selenograph::api {

enum class Format { npy, npz, png, tiff, exr, raw };

struct Representation {
  Format format;
  std::string_view media_type;
  std::string_view extension;  // of a file that holds it
  bool several;                // holds more than one product
  engine::ProductSet able;     // products that it can hold
  std::string_view meaning;
};

// In the order of the server's preference where a client leaves the choice.
std::span<const Representation> representations();
const Representation& representation(Format format);

// One of the forms of an answer other than a frame.
struct Alternative {
  std::string_view media_type;
  std::string_view meaning;
};
// Those of a round trip, in the order of the server's preference.
inline constexpr Alternative kRoundTripAnswers[] = {
    {"application/json", "the statistics"},
    {"image/tiff", "the differences as GeoTIFF: float32 metres, NaN where nothing was compared"},
};
// The one that `accept` gives the most weight, among equals the first. Throws RequestError "not_acceptable".
std::string_view choose(const std::string& accept, std::span<const Alternative> alternatives);

// "application/json" and the like: does `accept` allow it? Empty means anything.
bool accepts(const std::string& accept, std::string_view media_type);

// The representation for these products under `accept` (several Accept headers joined with commas; empty: anything).
// Highest q wins; among equals a lone `image` is a PNG, one product an .npy, several an .npz.
// Throws RequestError: "invalid_request" pointing at /products when what is accepted can't hold them, "not_acceptable"
// when nothing that is accepted exists.
const Representation& negotiate(const std::string& accept, engine::ProductSet products);

}  // namespace selenograph::api
