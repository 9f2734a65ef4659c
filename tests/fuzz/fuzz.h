// What the fuzz targets share. Each target is one file with LLVMFuzzerTestOneInput: libFuzzer drives it where the build
// has SELENOGRAPH_FUZZ, replay.cpp everywhere else.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace selenograph::fuzz {

inline std::string_view text_of(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

// A broken promise ends the run as a crash does, and libFuzzer keeps the input.
inline void require(bool kept, std::string_view promise, std::string_view detail = "") {
  if (kept) return;
  std::fprintf(stderr, "broken promise: %.*s %.*s\n", static_cast<int>(promise.size()), promise.data(),
               static_cast<int>(detail.size()), detail.data());
  std::abort();
}

}  // namespace selenograph::fuzz
