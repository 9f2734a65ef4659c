// Encodes products: NumPy .npy/.npz, PNG, TIFF, OpenEXR, raw little-endian.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "dem/base/stop_token.h"

namespace selenograph::api {

// Type of an array's elements. A boolean is a byte, 0 or 1.
enum class ElementType { boolean, uint8, uint16, uint64, float16, float32, float64 };

// One product as an array: height x width (x channels when channels > 1), C order. Non-owning: `data` points into a
// Frame, `name` to static text.
struct ArrayView {
  std::string_view name;  // "radiance"
  ElementType type;
  int height, width, channels;  // channels 1 or 3
  const void* data;             // native (little-endian) elements
  // Channel names in OpenEXR: {"radiance"}, or {"position.x", "position.y", "position.z"}.
  std::vector<std::string> channel_names;
  // Shape in .npy and .npz, of any rank, with the same number of elements; empty: (height, width[, channels]).
  std::vector<std::size_t> shape{};
};

std::size_t element_size(ElementType type);
std::string numpy_descr(ElementType type);  // "<f4", "|u1", ...

// All encoders are deterministic: the same arrays and attributes give the same bytes (no dates, no library versions).
// They throw std::invalid_argument for data that the format cannot hold, Cancelled when `stop` is requested.
// Thread-safe.

// Returns native elements, which are little-endian on all supported platforms.
std::string encode_raw(const ArrayView& array);

// Returns NPY 1.0 with the shape (height, width), (height, width, channels) or the array's own. The data begin at a
// multiple of 64 bytes.
std::string encode_npy(const ArrayView& array);

// Returns one .npy per array plus meta.json, in a zip archive. Names must differ. `deflated`: all members are, as by
// numpy.savez_compressed, but at zlib's fastest level; their bytes depend on zlib's version.
std::string encode_npz(const std::vector<ArrayView>& arrays, const std::string& meta_json, const StopToken& stop = {},
                       bool deflated = false);

// Text metadata as (name, value), e.g. {"selenograph", meta_json}.
using Attributes = std::vector<std::pair<std::string, std::string>>;

// Returns a PNG of one grey channel, uint8 or uint16. Attributes become text chunks, which most readers take for
// Latin-1: use ASCII.
std::string encode_png(const ArrayView& array, const Attributes& attributes, const StopToken& stop = {});

// Returns a TIFF of any element type with 1 or 3 channels; float64 is preserved. TIFF has one text field for
// attributes: ImageDescription holds their values, one per line.
std::string encode_tiff(const ArrayView& array, const Attributes& attributes, const StopToken& stop = {});

// Returns an OpenEXR with all arrays, of equal height and width, as named channels. Attributes become header
// attributes. OpenEXR has no double, and a lunar coordinate rounded to float is off by up to 6 cm: a float64 channel
// "depth" is written as float "depth" plus float "depth.residual" (double - float). Their sum in double is accurate to
// 2^-49 of the value, 2 nm at the Moon's radius. Integers become uint32 channels, float32 is preserved.
std::string encode_exr(const std::vector<ArrayView>& arrays, const Attributes& attributes, const StopToken& stop = {});

}  // namespace selenograph::api
