// Reads .npz archives: the arrays of a request, as numpy.savez and numpy.savez_compressed write them, and a text.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "dem/base/stop_token.h"

namespace selenograph::api {

// An array: numbers of any type, converted to double, in C order; or a text, from an array with one string.
struct NpzArray {
  std::vector<std::size_t> shape;
  std::vector<double> numbers;
  std::optional<std::string> text;  // UTF-8
};
using NpzArrays = std::map<std::string, NpzArray>;

// Returns the arrays by name, without ".npy"; a member "NAME.json" becomes the text "NAME". The reader is strict:
// NPY 1.0 to 3.0, little-endian numbers of up to 8 bytes or booleans, C or Fortran order, stored or deflated, each name
// once, nothing else.
//
// `max_bytes` limits the size of all arrays unpacked. Throws RequestError "malformed_npz" that names the array, or
// "too_large".
NpzArrays read_npz(std::string_view bytes, std::size_t max_bytes, const StopToken& stop = {});

// Returns the text of the member `name` (with its extension) of an archive within a file, which begins at `offset` and
// has `bytes` bytes; empty if there is no such member. Nothing else is unpacked. Throws std::runtime_error naming the
// file.
std::optional<std::string> text_in_npz(const std::string& path, std::uint64_t offset, std::uint64_t bytes,
                                       const std::string& name);

// Returns the array in the content of an .npy file; `name` is used in errors.
NpzArray read_npy(std::string_view bytes, const std::string& name);

}  // namespace selenograph::api
