// Image files through OpenImageIO, in a shared library that the first image loads: with the 144 libraries that
// OpenImageIO needs, which would be more than half of what a start of the program costs.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "api/encode/encode.h"

namespace selenograph::api {

struct ImageSize {
  std::size_t width, height;
  int channels;
  std::string type;  // of a sample, in OpenImageIO's words: "float", "uint16"
  bool is_floating_point;
};

// Functions of the library; the encoders are documented in encode.h.
struct ImageLibrary {
  std::string (*png)(const ArrayView& array, const Attributes& attributes, const StopToken& stop);
  std::string (*tiff)(const ArrayView& array, const Attributes& attributes, const StopToken& stop);
  std::string (*exr)(const std::vector<ArrayView>& arrays, const Attributes& attributes, const StopToken& stop);
  // Writes the samples of a file in row-major order, channels interleaved, to where `destination` says for its size.
  // Throws DataError naming the file, and what `destination` throws.
  void (*read)(const std::string& path, const std::function<double*(const ImageSize&)>& destination);
};

// Loads the library when it is first called. Throws std::runtime_error naming it when it cannot be loaded. Thread-safe.
const ImageLibrary& image_library();

}  // namespace selenograph::api
