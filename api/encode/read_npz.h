// Reads .npz archives: the arrays of a request, as numpy.savez and numpy.savez_compressed write them, and a text.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "dem/base/stop_token.h"

namespace selenograph::api {

// Numbers of any type, as double; or a text (of a 0-dimensional array of one). C order.
struct NpzArray {
  std::vector<std::size_t> shape;
  std::vector<double> numbers;
  std::optional<std::string> text;  // UTF-8
};
using NpzArrays = std::map<std::string, NpzArray>;

// Arrays by name, without ".npy"; of a member "NAME.json" its text as "NAME". Strict: NPY 1.0 to 3.0, little-endian
// numbers of up to 8 bytes or booleans, C order or Fortran's, stored or deflated, each name once, nothing else.
// `max_bytes`: of all arrays unpacked. `claim`, which may be empty, is called once before anything is unpacked, with
// the memory that reading takes, the result included. Throws RequestError "malformed_npz" that names the array, or
// "too_large".
NpzArrays read_npz(std::string_view bytes, std::size_t max_bytes,
                   const std::function<void(std::size_t bytes)>& claim = {}, const StopToken& stop = {});

// The text member `name` (its whole name) of the archive in `bytes` of a file from `offset` on, without reading the
// rest; empty if there is none. Throws std::runtime_error naming the file.
std::optional<std::string> text_in_npz(const std::string& path, std::uint64_t offset, std::uint64_t bytes,
                                       const std::string& name);

// One array's file: the content of an .npy; `name` for errors.
NpzArray read_npy(std::string_view bytes, const std::string& name);

}  // namespace selenograph::api
